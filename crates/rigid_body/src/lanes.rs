//! Small vectors and matrices of numbers that may be several at once.
//!
//! A quadruped's legs are alike: the same recursion with other numbers. [`Lane`] is a number per leg,
//! held in one vector register, so that the code of [`crate::limbs`] reads as if there were one leg.

use std::ops::{Add, AddAssign, Mul, Neg, Sub};

use wide::{f64x2, f64x4};

/// A number, or one for each leg.
pub(crate) trait Lane:
    Copy + std::fmt::Debug + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self>
{
    /// How many numbers.
    const WIDTH: usize;
    fn splat(x: f64) -> Self;
    fn build(f: impl Fn(usize) -> f64) -> Self;
    fn lane(self, i: usize) -> f64;
    /// Sum over the lanes.
    fn sum(self) -> f64;
    fn sin_cos(self) -> (Self, Self);
    /// self · a + b, in one operation where the target has it.
    fn mul_add(self, a: Self, b: Self) -> Self;
    fn inverse(self) -> Self;
}

impl Lane for f64 {
    const WIDTH: usize = 1;
    #[inline(always)]
    fn splat(x: f64) -> Self {
        x
    }
    #[inline(always)]
    fn build(f: impl Fn(usize) -> f64) -> Self {
        f(0)
    }
    #[inline(always)]
    fn lane(self, _: usize) -> f64 {
        self
    }
    #[inline(always)]
    fn sum(self) -> f64 {
        self
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        f64::sin_cos(self)
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        // Without the instruction f64::mul_add is a slow library call.
        if cfg!(target_feature = "fma") { f64::mul_add(self, a, b) } else { self * a + b }
    }
    #[inline(always)]
    fn inverse(self) -> Self {
        1.0 / self
    }
}

macro_rules! lane {
    ($simd:ty, $width:literal) => {
        impl Lane for $simd {
            const WIDTH: usize = $width;
            #[inline(always)]
            fn splat(x: f64) -> Self {
                <$simd>::splat(x)
            }
            #[inline(always)]
            fn build(f: impl Fn(usize) -> f64) -> Self {
                <$simd>::new(std::array::from_fn(f))
            }
            #[inline(always)]
            fn lane(self, i: usize) -> f64 {
                self.to_array()[i]
            }
            #[inline(always)]
            fn sum(self) -> f64 {
                self.reduce_add()
            }
            #[inline(always)]
            fn sin_cos(self) -> (Self, Self) {
                <$simd>::sin_cos(self)
            }
            #[inline(always)]
            fn mul_add(self, a: Self, b: Self) -> Self {
                <$simd>::mul_add(self, a, b)
            }
            #[inline(always)]
            fn inverse(self) -> Self {
                <$simd>::splat(1.0) / self
            }
        }
    };
}

lane!(f64x2, 2);
lane!(f64x4, 4);

/// A vector in space.
#[derive(Debug, Clone, Copy)]
pub(crate) struct V3<T> {
    pub x: T,
    pub y: T,
    pub z: T,
}

impl<T: Lane> V3<T> {
    #[inline(always)]
    pub fn new(x: T, y: T, z: T) -> Self {
        Self { x, y, z }
    }

    #[inline(always)]
    pub fn zero() -> Self {
        Self::splat(&V3::new(0.0, 0.0, 0.0))
    }

    #[inline(always)]
    pub fn splat(v: &V3<f64>) -> Self {
        Self::new(T::splat(v.x), T::splat(v.y), T::splat(v.z))
    }

    pub fn build(f: impl Fn(usize) -> nalgebra::Vector3<f64>) -> Self {
        Self::new(T::build(|i| f(i).x), T::build(|i| f(i).y), T::build(|i| f(i).z))
    }

    #[inline(always)]
    pub fn lane(&self, i: usize) -> nalgebra::Vector3<f64> {
        nalgebra::Vector3::new(self.x.lane(i), self.y.lane(i), self.z.lane(i))
    }

    #[inline(always)]
    pub fn sum(&self) -> V3<f64> {
        V3::new(self.x.sum(), self.y.sum(), self.z.sum())
    }

    #[inline(always)]
    pub fn dot(&self, o: &Self) -> T {
        self.x.mul_add(o.x, self.y.mul_add(o.y, self.z * o.z))
    }

    #[inline(always)]
    pub fn cross(&self, o: &Self) -> Self {
        Self::new(
            self.y.mul_add(o.z, -(self.z * o.y)),
            self.z.mul_add(o.x, -(self.x * o.z)),
            self.x.mul_add(o.y, -(self.y * o.x)),
        )
    }

    #[inline(always)]
    pub fn scaled(&self, s: T) -> Self {
        Self::new(self.x * s, self.y * s, self.z * s)
    }

    /// self + o · s.
    #[inline(always)]
    pub fn plus_scaled(&self, o: &Self, s: T) -> Self {
        Self::new(o.x.mul_add(s, self.x), o.y.mul_add(s, self.y), o.z.mul_add(s, self.z))
    }
}

impl<T: Lane> Add for V3<T> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self::new(self.x + o.x, self.y + o.y, self.z + o.z)
    }
}

impl<T: Lane> Sub for V3<T> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Self::new(self.x - o.x, self.y - o.y, self.z - o.z)
    }
}

impl<T: Lane> AddAssign for V3<T> {
    #[inline(always)]
    fn add_assign(&mut self, o: Self) {
        *self = *self + o;
    }
}

/// A matrix by its columns.
#[derive(Debug, Clone, Copy)]
pub(crate) struct M3<T> {
    pub a: V3<T>,
    pub b: V3<T>,
    pub c: V3<T>,
}

impl<T: Lane> M3<T> {
    pub fn build(f: impl Fn(usize) -> nalgebra::Matrix3<f64>) -> Self {
        let column = |k: usize| V3::build(|i| f(i).column(k).into_owned());
        Self { a: column(0), b: column(1), c: column(2) }
    }

    #[inline(always)]
    pub fn splat(m: &M3<f64>) -> Self {
        Self { a: V3::splat(&m.a), b: V3::splat(&m.b), c: V3::splat(&m.c) }
    }

    #[inline(always)]
    pub fn lane(&self, i: usize) -> nalgebra::Matrix3<f64> {
        nalgebra::Matrix3::from_columns(&[self.a.lane(i), self.b.lane(i), self.c.lane(i)])
    }

    #[inline(always)]
    pub fn times(&self, v: &V3<T>) -> V3<T> {
        self.a.scaled(v.x).plus_scaled(&self.b, v.y).plus_scaled(&self.c, v.z)
    }

    /// Transpose times v.
    #[inline(always)]
    pub fn transpose_times(&self, v: &V3<T>) -> V3<T> {
        V3::new(self.a.dot(v), self.b.dot(v), self.c.dot(v))
    }

    #[inline(always)]
    pub fn product(&self, o: &Self) -> Self {
        Self { a: self.times(&o.a), b: self.times(&o.b), c: self.times(&o.c) }
    }

    #[inline(always)]
    pub fn trace(&self) -> T {
        self.a.x + self.b.y + self.c.z
    }

    #[inline(always)]
    pub fn plus(&self, o: &Self) -> Self {
        Self { a: self.a + o.a, b: self.b + o.b, c: self.c + o.c }
    }

    #[inline(always)]
    pub fn sum(&self) -> M3<f64> {
        M3 { a: self.a.sum(), b: self.b.sum(), c: self.c.sum() }
    }
}

/// A symmetric matrix.
#[derive(Debug, Clone, Copy)]
pub(crate) struct S3<T> {
    pub xx: T,
    pub xy: T,
    pub xz: T,
    pub yy: T,
    pub yz: T,
    pub zz: T,
}

impl<T: Lane> S3<T> {
    pub fn build(f: impl Fn(usize) -> nalgebra::Matrix3<f64>) -> Self {
        let entry = |r: usize, c: usize| T::build(|i| f(i)[(r, c)]);
        Self { xx: entry(0, 0), xy: entry(0, 1), xz: entry(0, 2), yy: entry(1, 1), yz: entry(1, 2), zz: entry(2, 2) }
    }

    #[inline(always)]
    pub fn times(&self, v: &V3<T>) -> V3<T> {
        V3::new(
            self.xx.mul_add(v.x, self.xy.mul_add(v.y, self.xz * v.z)),
            self.xy.mul_add(v.x, self.yy.mul_add(v.y, self.yz * v.z)),
            self.xz.mul_add(v.x, self.yz.mul_add(v.y, self.zz * v.z)),
        )
    }

    #[inline(always)]
    pub fn trace(&self) -> T {
        self.xx + self.yy + self.zz
    }

    #[inline(always)]
    pub fn plus(&self, o: &Self) -> Self {
        Self {
            xx: self.xx + o.xx,
            xy: self.xy + o.xy,
            xz: self.xz + o.xz,
            yy: self.yy + o.yy,
            yz: self.yz + o.yz,
            zz: self.zz + o.zz,
        }
    }

    /// self + p dᵀ + d pᵀ.
    #[inline(always)]
    pub fn plus_symmetric(&self, p: &V3<T>, d: &V3<T>) -> Self {
        let two = T::splat(2.0);
        Self {
            xx: (p.x * d.x).mul_add(two, self.xx),
            xy: p.x.mul_add(d.y, d.x.mul_add(p.y, self.xy)),
            xz: p.x.mul_add(d.z, d.x.mul_add(p.z, self.xz)),
            yy: (p.y * d.y).mul_add(two, self.yy),
            yz: p.y.mul_add(d.z, d.y.mul_add(p.z, self.yz)),
            zz: (p.z * d.z).mul_add(two, self.zz),
        }
    }

    /// self − v vᵀ · s.
    #[inline(always)]
    pub fn minus_square(&self, v: &V3<T>, s: T) -> Self {
        let m = v.scaled(-s);
        Self {
            xx: m.x.mul_add(v.x, self.xx),
            xy: m.x.mul_add(v.y, self.xy),
            xz: m.x.mul_add(v.z, self.xz),
            yy: m.y.mul_add(v.y, self.yy),
            yz: m.y.mul_add(v.z, self.yz),
            zz: m.z.mul_add(v.z, self.zz),
        }
    }

    /// R self Rᵀ.
    #[inline(always)]
    pub fn turned(&self, r: &M3<T>) -> Self {
        // Columns of R self, then its products with the rows of R.
        let a = r.times(&V3::new(self.xx, self.xy, self.xz));
        let b = r.times(&V3::new(self.xy, self.yy, self.yz));
        let c = r.times(&V3::new(self.xz, self.yz, self.zz));
        let entry =
            |left: (T, T, T), right: (T, T, T)| left.0.mul_add(right.0, left.1.mul_add(right.1, left.2 * right.2));
        let (x, y, z) = ((a.x, b.x, c.x), (a.y, b.y, c.y), (a.z, b.z, c.z));
        let (rx, ry, rz) = ((r.a.x, r.b.x, r.c.x), (r.a.y, r.b.y, r.c.y), (r.a.z, r.b.z, r.c.z));
        Self {
            xx: entry(x, rx),
            xy: entry(x, ry),
            xz: entry(x, rz),
            yy: entry(y, ry),
            yz: entry(y, rz),
            zz: entry(z, rz),
        }
    }

    #[inline(always)]
    pub fn sum(&self) -> S3<f64> {
        S3 {
            xx: self.xx.sum(),
            xy: self.xy.sum(),
            xz: self.xz.sum(),
            yy: self.yy.sum(),
            yz: self.yz.sum(),
            zz: self.zz.sum(),
        }
    }
}
