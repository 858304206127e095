//! Derivatives of inverse dynamics.

use nalgebra::Vector3;

use super::inverse_dynamics::{base_column, torso_mass};
use super::links::LimbModel;
use super::pass::{LimbData, TURNS, Torso};
use crate::lanes::{Lane, M3, V3};
use crate::spatial::{Composite, Force, Motion};

/// Where the results go: column-major matrices of n × n entries. Those that are zero by structure are not written.
struct Results<'a> {
    n: usize,
    tau: &'a mut [f64],
    mass: &'a mut [f64],
    dtau_dq: &'a mut [f64],
    dtau_dv: &'a mut [f64],
}

impl<T: Lane> LimbData<T> {
    /// τ and its derivatives from the last forward pass, of order 2, without point forces. The
    /// matrices are column-major, n × n; entries that are zero by structure are not written.
    #[inline(always)]
    pub fn inverse_dynamics_derivatives(
        &self,
        model: &LimbModel<T>,
        gravity: &Vector3<f64>,
        tau: &mut [f64],
        mass: &mut [f64],
        dtau_dq: &mut [f64],
        dtau_dv: &mut [f64],
    ) {
        let mut out = Results { n: 6 + 3 * T::WIDTH, tau, mass, dtau_dq, dtau_dv };
        let gravity = V3::new(gravity.x, gravity.y, gravity.z);
        let torso = &self.torso;
        let lifted = torso.acceleration - gravity;
        let torso_rates_2 = torso.axis_rates_2(&lifted);
        let base = BaseAxes {
            axis: torso.axis.map(|axis| V3::splat(&axis)),
            rate: torso.axis_rate.map(|rate| V3::splat(&rate)),
            rate_2: torso_rates_2.map(|rate_2| Motion::splat(&rate_2)),
        };
        let fall = V3::splat(&gravity);
        let link_rates_2 = self.axis_rates_2(&fall);

        let mut sum: Option<Subtree<T>> = None;
        for k in (0..3).rev() {
            let (joint, link) = (&model.joints[k], &self.links[k]);
            let mut lifted = link.acceleration;
            lifted.linear = lifted.linear - fall;
            let inertia = joint.link.composite(&link.rotation, &link.position);
            let own = Subtree::of(inertia, &link.velocity, &lifted);
            let subtree = sum.map_or(own, |below| own.plus(&below));
            let column = subtree.column(&link.axis, &link.axis_rate, &link_rates_2[k]);
            let torque = link.axis.dot(&subtree.force);
            for leg in 0..T::WIDTH {
                out.tau[joint.dof[leg]] = torque.lane(leg);
            }
            self.write_within_leg(model, k, &column, &link_rates_2, &mut out);
            base.write_with_leg(&joint.dof, &column, &mut out);
            sum = Some(subtree);
        }

        let inertia = model.torso.composite(&torso.rotation, &V3::zero());
        let lifted = Motion { angular: torso.spin_rate[2], linear: lifted };
        let own = Subtree::of(inertia, &Motion::turn(torso.spin[2]), &lifted);
        let total = sum.map_or(own, |legs| own.plus(&legs.sum()));
        torso.write_own(&total, &torso_rates_2, &mut out);
        torso_mass(torso, &total.inertia, out.mass, out.n);
    }

    /// S̈ of the links' joints, gravity included.
    #[inline(always)]
    fn axis_rates_2(&self, fall: &V3<T>) -> [Motion<V3<T>>; 3] {
        let torso = &self.torso;
        std::array::from_fn(|k| {
            let (velocity, mut acceleration) = match k {
                0 => (
                    Motion::turn(V3::splat(&torso.spin[2])),
                    Motion { angular: V3::splat(&torso.spin_rate[2]), linear: V3::splat(&torso.acceleration) },
                ),
                _ => (self.links[k - 1].velocity, self.links[k - 1].acceleration),
            };
            acceleration.linear = acceleration.linear - *fall;
            acceleration.cross(&self.links[k].axis) + velocity.cross(&self.links[k].axis_rate)
        })
    }

    /// The entries between a leg's k-th joint and those above it in the leg.
    #[inline(always)]
    fn write_within_leg(
        &self,
        model: &LimbModel<T>,
        k: usize,
        column: &Column<T>,
        link_rates_2: &[Motion<V3<T>>; 3],
        out: &mut Results,
    ) {
        let (n, two) = (out.n, T::splat(2.0));
        for j in 0..=k {
            let up = &self.links[j];
            let m = up.axis.dot(&column.momentum);
            let up_q = up.axis.dot(&column.q);
            let up_v = up.axis.dot(&column.v);
            let down_q = up.axis_rate.angular.dot(&column.row) + link_rates_2[j].dot(&column.momentum);
            let down_v = up.axis.angular.dot(&column.row).plus_product(up.axis_rate.dot(&column.momentum), two);
            for leg in 0..T::WIDTH {
                let (here, above) = (model.joints[k].dof[leg], model.joints[j].dof[leg]);
                out.mass[here + n * above] = m.lane(leg);
                out.mass[above + n * here] = m.lane(leg);
                out.dtau_dq[above + n * here] = up_q.lane(leg);
                out.dtau_dv[above + n * here] = up_v.lane(leg);
                out.dtau_dq[here + n * above] = down_q.lane(leg);
                out.dtau_dv[here + n * above] = down_v.lane(leg);
            }
        }
    }
}

/// S, Ṡ and S̈ of the torso's turning joints, the same for every leg.
struct BaseAxes<T> {
    axis: [V3<T>; 3],
    rate: [V3<T>; 3],
    rate_2: [Motion<V3<T>>; 3],
}

impl<T: Lane> BaseAxes<T> {
    /// The entries between a leg's joint and the base.
    #[inline(always)]
    fn write_with_leg(&self, dof: &[usize; 4], column: &Column<T>, out: &mut Results) {
        let (n, two) = (out.n, T::splat(2.0));
        let base_m = base_column(&self.axis, &column.momentum);
        let base_q = base_column(&self.axis, &column.q);
        let base_v = base_column(&self.axis, &column.v);
        for leg in 0..T::WIDTH {
            let dof = dof[leg];
            for row in 0..6 {
                out.mass[row + n * dof] = base_m[row].lane(leg);
                out.mass[dof + n * row] = base_m[row].lane(leg);
                out.dtau_dq[row + n * dof] = base_q[row].lane(leg);
                out.dtau_dv[row + n * dof] = base_v[row].lane(leg);
            }
        }
        for i in 0..3 {
            let down_q = self.rate[i].dot(&column.row) + self.rate_2[i].dot(&column.momentum);
            let down_v = self.axis[i].dot(&column.row).plus_product(self.rate[i].dot(&column.momentum.moment), two);
            for leg in 0..T::WIDTH {
                out.dtau_dq[dof[leg] + n * TURNS[i]] = down_q.lane(leg);
                out.dtau_dv[dof[leg] + n * TURNS[i]] = down_v.lane(leg);
            }
        }
    }
}

impl Torso {
    /// S̈ of yaw, pitch, roll; `lifted` is the origin's acceleration less gravity.
    #[inline(always)]
    fn axis_rates_2(&self, lifted: &V3<f64>) -> [Motion<V3<f64>>; 3] {
        std::array::from_fn(|i| {
            let (spin, spin_rate) = match i {
                0 => (V3::zero(), V3::zero()),
                _ => (self.spin[i - 1], self.spin_rate[i - 1]),
            };
            Motion {
                angular: spin_rate.cross(&self.axis[i]) + spin.cross(&self.axis_rate[i]),
                linear: lifted.cross(&self.axis[i]),
            }
        })
    }

    /// The base's own rows of τ and its derivatives, given the whole robot's sums.
    #[inline(always)]
    fn write_own(&self, total: &Subtree<f64>, rates_2: &[Motion<V3<f64>>; 3], out: &mut Results) {
        let n = out.n;
        out.tau[..3].copy_from_slice(&[total.force.force.x, total.force.force.y, total.force.force.z]);
        for i in 0..3 {
            let (axis, rate) = (Motion::turn(self.axis[i]), Motion::turn(self.axis_rate[i]));
            let column = total.column(&axis, &rate, &rates_2[i]);
            let dof = TURNS[i];
            out.tau[dof] = axis.dot(&total.force);
            for j in 0..=i {
                let above = TURNS[j];
                out.dtau_dq[above + n * dof] = self.axis[j].dot(&column.q.moment);
                out.dtau_dv[above + n * dof] = self.axis[j].dot(&column.v.moment);
                out.dtau_dq[dof + n * above] = self.axis_rate[j].dot(&column.row) + rates_2[j].dot(&column.momentum);
                out.dtau_dv[dof + n * above] =
                    self.axis[j].dot(&column.row) + 2.0 * self.axis_rate[j].dot(&column.momentum.moment);
            }
            let (q, v) = (&column.q.force, &column.v.force);
            out.dtau_dq[n * dof..n * dof + 3].copy_from_slice(&[q.x, q.y, q.z]);
            out.dtau_dv[n * dof..n * dof + 3].copy_from_slice(&[v.x, v.y, v.z]);
        }
    }
}

/// Sums over a link and all below it that the derivatives need: see [`crate::derivatives`].
#[derive(Debug, Clone, Copy)]
struct Subtree<T: Lane> {
    inertia: Composite<V3<T>>,
    force: Force<V3<T>>,
    /// Σ m ṗ pᵀ.
    moment_rate: M3<T>,
    /// Σ m ṗ.
    momentum: V3<T>,
}

/// What one joint contributes to its rows and columns.
struct Column<T: Lane> {
    /// I S.
    momentum: Force<V3<T>>,
    /// 2 B Ṡ + I S̈ + S ×* f.
    q: Force<V3<T>>,
    /// 2 B S + 2 I Ṡ.
    v: Force<V3<T>>,
    /// 2 Bᵀ S, which has no linear part.
    row: V3<T>,
}

impl<T: Lane> Subtree<T> {
    /// Of one body; `lifted` is its acceleration less gravity.
    #[inline(always)]
    fn of(inertia: Composite<V3<T>>, velocity: &Motion<V3<T>>, lifted: &Motion<V3<T>>) -> Self {
        let (v, w) = (&velocity.linear, &velocity.angular);
        let momentum = inertia.times(velocity);
        let s = &inertia.second;
        let column = |first: T, second: V3<T>| w.cross(&second).plus_scaled(v, first);
        Self {
            force: inertia.times(lifted) + velocity.cross_force(&momentum),
            moment_rate: M3 {
                a: column(inertia.first.x, V3::new(s.xx, s.xy, s.xz)),
                b: column(inertia.first.y, V3::new(s.xy, s.yy, s.yz)),
                c: column(inertia.first.z, V3::new(s.xz, s.yz, s.zz)),
            },
            momentum: momentum.force,
            inertia,
        }
    }

    #[inline(always)]
    fn plus(&self, o: &Self) -> Self {
        Self {
            inertia: self.inertia.plus(&o.inertia),
            force: self.force + o.force,
            moment_rate: self.moment_rate.plus(&o.moment_rate),
            momentum: self.momentum + o.momentum,
        }
    }

    #[inline(always)]
    fn sum(&self) -> Subtree<f64> {
        Subtree {
            inertia: self.inertia.sum(),
            force: self.force.sum(),
            moment_rate: self.moment_rate.sum(),
            momentum: self.momentum.sum(),
        }
    }

    #[inline(always)]
    fn column(&self, axis: &Motion<V3<T>>, rate: &Motion<V3<T>>, rate_2: &Motion<V3<T>>) -> Column<T> {
        let two = T::splat(2.0);
        let trace = self.moment_rate.trace();
        let twice_b = |u: &V3<T>| Force {
            moment: (u.scaled(trace) - self.moment_rate.times(u)).scaled(two),
            force: u.cross(&self.momentum).scaled(two),
        };
        let row = axis.angular.scaled(trace) - self.moment_rate.transpose_times(&axis.angular)
            + self.momentum.cross(&axis.linear);
        Column {
            momentum: self.inertia.times(axis),
            q: twice_b(&rate.angular) + self.inertia.times(rate_2) + axis.cross_force(&self.force),
            v: twice_b(&axis.angular).plus_scaled(&self.inertia.times(rate), two),
            row: row.scaled(two),
        }
    }
}

/// self + a · b: reads better than `mul_add` where self is the longer term.
trait PlusProduct: Lane {
    #[inline(always)]
    fn plus_product(self, a: Self, b: Self) -> Self {
        a.mul_add(b, self)
    }
}
impl<T: Lane> PlusProduct for T {}
