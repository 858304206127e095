//! What the spatial algebra needs of a vector in space and of the matrices that act on it: nalgebra's for one tree, and
//! those of [`crate::lanes`], which hold a number for each leg.

use std::ops::{Add, Sub};

use nalgebra::{Matrix3, Vector3};

use crate::lanes::{Lane, M3, S3, V3};

/// A vector in space.
pub(crate) trait Space: Copy + Add<Output = Self> + Sub<Output = Self> {
    type Scalar: Copy + Add<Output = Self::Scalar>;
    /// A symmetric matrix.
    type Symmetric: Square<Self>;
    /// Any matrix.
    type Matrix: Square<Self>;

    fn zero() -> Self;
    fn dot(&self, o: &Self) -> Self::Scalar;
    fn cross(&self, o: &Self) -> Self;
    fn scaled(&self, s: Self::Scalar) -> Self;
    /// self + o · s.
    fn plus_scaled(&self, o: &Self, s: Self::Scalar) -> Self;
}

/// A matrix that acts on vectors in space.
pub(crate) trait Square<V: Space>: Copy {
    fn times(&self, v: &V) -> V;
    /// Transpose times v.
    fn transpose_times(&self, v: &V) -> V;
    fn trace(&self) -> V::Scalar;
    fn plus(&self, o: &Self) -> Self;
}

impl Space for Vector3<f64> {
    type Scalar = f64;
    type Symmetric = Matrix3<f64>;
    type Matrix = Matrix3<f64>;

    #[inline(always)]
    fn zero() -> Self {
        Vector3::zeros()
    }
    #[inline(always)]
    fn dot(&self, o: &Self) -> f64 {
        Vector3::dot(self, o)
    }
    #[inline(always)]
    fn cross(&self, o: &Self) -> Self {
        Vector3::cross(self, o)
    }
    #[inline(always)]
    fn scaled(&self, s: f64) -> Self {
        self * s
    }
    #[inline(always)]
    fn plus_scaled(&self, o: &Self, s: f64) -> Self {
        self + o * s
    }
}

impl Square<Vector3<f64>> for Matrix3<f64> {
    #[inline(always)]
    fn times(&self, v: &Vector3<f64>) -> Vector3<f64> {
        self * v
    }
    #[inline(always)]
    fn transpose_times(&self, v: &Vector3<f64>) -> Vector3<f64> {
        self.tr_mul(v)
    }
    #[inline(always)]
    fn trace(&self) -> f64 {
        Matrix3::trace(self)
    }
    #[inline(always)]
    fn plus(&self, o: &Self) -> Self {
        self + o
    }
}

impl<T: Lane> Space for V3<T> {
    type Scalar = T;
    type Symmetric = S3<T>;
    type Matrix = M3<T>;

    #[inline(always)]
    fn zero() -> Self {
        V3::zero()
    }
    #[inline(always)]
    fn dot(&self, o: &Self) -> T {
        V3::dot(self, o)
    }
    #[inline(always)]
    fn cross(&self, o: &Self) -> Self {
        V3::cross(self, o)
    }
    #[inline(always)]
    fn scaled(&self, s: T) -> Self {
        V3::scaled(self, s)
    }
    #[inline(always)]
    fn plus_scaled(&self, o: &Self, s: T) -> Self {
        V3::plus_scaled(self, o, s)
    }
}

impl<T: Lane> Square<V3<T>> for S3<T> {
    #[inline(always)]
    fn times(&self, v: &V3<T>) -> V3<T> {
        S3::times(self, v)
    }
    #[inline(always)]
    fn transpose_times(&self, v: &V3<T>) -> V3<T> {
        S3::times(self, v)
    }
    #[inline(always)]
    fn trace(&self) -> T {
        S3::trace(self)
    }
    #[inline(always)]
    fn plus(&self, o: &Self) -> Self {
        S3::plus(self, o)
    }
}

impl<T: Lane> Square<V3<T>> for M3<T> {
    #[inline(always)]
    fn times(&self, v: &V3<T>) -> V3<T> {
        M3::times(self, v)
    }
    #[inline(always)]
    fn transpose_times(&self, v: &V3<T>) -> V3<T> {
        M3::transpose_times(self, v)
    }
    #[inline(always)]
    fn trace(&self) -> T {
        M3::trace(self)
    }
    #[inline(always)]
    fn plus(&self, o: &Self) -> Self {
        M3::plus(self, o)
    }
}
