//! Where a full-order program's solve starts: from the decomposed program, its second step the mirror image of the
//! first, bent where the gait turns or steps aside; or from the kinematics of all four legs.

use super::FullOrderProgram;
use super::footfalls::Footfalls;
use super::schedule::{COEFFICIENTS, DOF, Place, at};
use super::stride::mirror_point;
use crate::decomposed::DecomposedPlanner;
use crate::guess::{self, Unreachable, swing_arc};
use crate::planar::PlanarMotion;
use crate::program::DecomposedProgram;
use crate::recompose::compensated_reference;
use crate::request::GaitRequest;
use crate::{PlanOptions, SubproblemSolver, on_slope};
use gait::{JOINTS, bezier};
use nalgebra::{DMatrix, Vector2, Vector3};
use rigid_body::{Data, point_kinematics, rnea};
use robot::Robot;
use std::ops::ControlFlow;

/// The decomposed program's own guess. `robot` is on the slope.
pub(super) fn of_the_guess(
    program: &FullOrderProgram,
    decomposed: &mut DecomposedProgram,
    robot: &Robot,
    level: &GaitRequest,
) -> Result<Vec<f64>, Unreachable> {
    let x = guess::nominal(robot, decomposed, level)?;
    Ok(recomposed(program, decomposed, &x))
}

/// The decomposed program's plan of a request that it knows, or its guess where there is none.
pub(super) fn of_the_plan(
    program: &FullOrderProgram,
    decomposed: &mut DecomposedProgram,
    planner: &mut DecomposedPlanner,
    level: &GaitRequest,
    options: &PlanOptions,
) -> Result<Vec<f64>, Unreachable> {
    let options = PlanOptions { subproblem: SubproblemSolver::default(), warm_start: None, ..options.clone() };
    match planner.solve(level, &options, |_| ControlFlow::Continue(())) {
        Ok(solution) => Ok(recomposed(program, decomposed, &solution.x)),
        Err(_) => of_the_guess(program, decomposed, &on_slope(planner.robot(), level), level),
    }
}

/// A straight gait's unknowns, bent: what the kinematics of a request that turns or steps aside differ by from those of
/// the straight one is added. `robot` is on the slope.
pub(super) fn bent(
    program: &FullOrderProgram,
    decomposed: &DecomposedProgram,
    robot: &Robot,
    mut straight_x: Vec<f64>,
    [straight, moved]: [&GaitRequest; 2],
) -> Result<Vec<f64>, Unreachable> {
    let hip_x_m = decomposed.bipeds.hips_x_m();
    let [from, to] = [straight, moved].map(|request| of_four_legs(program, hip_x_m, robot, request));
    for (x, (from, to)) in straight_x.iter_mut().zip(from?.into_iter().zip(to?)) {
        *x += to - from;
    }
    Ok(straight_x)
}

/// All four legs by inverse kinematics, as [`crate::guess::nominal`] places the front ones: the body glides along its
/// motion, a stance toe is at its place under the body in the middle of its stance, swing toes go from one such place
/// to the next. `robot` is on the slope; `hip_x_m` is where its hips are.
pub(super) fn of_four_legs(
    program: &FullOrderProgram,
    hip_x_m: [f64; 4],
    robot: &Robot,
    request: &GaitRequest,
) -> Result<Vec<f64>, Unreachable> {
    let schedule = &program.schedule;
    let footfalls = schedule.has_footholds().then(|| Footfalls::new(schedule, &robot.mirror, request, hip_x_m));
    let glide = Glide { request, motion: PlanarMotion::of(request), hip_x_m, footfalls };
    let mut x = vec![0.0; schedule.unknowns];
    x[schedule.t()] = request.step_duration_s;
    let mut near = robot.stand_rad();
    let mut data = Data::new(&robot.model);
    for (domain, d) in schedule.domains.iter().enumerate() {
        let places = schedule.places_of(domain);
        let mut joints = DMatrix::zeros(places.len(), JOINTS);
        for place in places {
            for leg in 0..4 {
                let target = glide.toe(place, leg, d.stance.contains(&leg));
                let found = inverse_kinematics(robot, &mut data, leg, glide.base(place), &near, target)
                    .ok_or_else(|| glide.unreachable(robot, place, leg, target))?;
                near[3 * leg..3 * leg + 3].copy_from_slice(&found);
            }
            joints.row_mut(place.point).copy_from_slice(&near);
        }
        let values = DMatrix::from_fn(places.len(), COEFFICIENTS, |p, k| bezier::basis(places[p].phase)[k]);
        let fit = values.svd(true, true).solve(&joints, 1e-12).expect("both factors were asked for");
        for k in 0..COEFFICIENTS {
            for j in 0..JOINTS {
                x[schedule.alpha(domain, k, j)] = fit[(k, j)];
            }
        }
        for place in places {
            glide.put_point(program, robot, &mut data, place, &fit, &mut x);
        }
    }
    Ok(x)
}

/// A body that glides at constant height along a planar motion.
struct Glide<'a> {
    request: &'a GaitRequest,
    motion: PlanarMotion,
    hip_x_m: [f64; 4],
    /// Of schedules with footholds; the trot's are said by its steps.
    footfalls: Option<Footfalls>,
}

impl Glide<'_> {
    fn time_s(&self, place: &Place) -> f64 {
        place.time * self.request.step_duration_s
    }

    fn base(&self, place: &Place) -> [f64; 6] {
        let t = self.time_s(place);
        let d = self.motion.displacement_m(t);
        [d.x, d.y, self.request.height_m, 0.0, 0.0, self.motion.yaw_rad(t)]
    }

    /// A toe's place on the floor when the body is where it is at `t`.
    fn under_the_body(&self, leg: usize, t: f64) -> Vector2<f64> {
        let half_width_m = if leg < 2 { self.request.half_width_m } else { -self.request.half_width_m };
        let toe = Vector2::new(self.hip_x_m[leg], half_width_m);
        self.motion.displacement_m(t) + self.motion.rotation(t) * toe
    }

    fn toe(&self, place: &Place, leg: usize, is_stance: bool) -> Vector3<f64> {
        if let Some(footfalls) = &self.footfalls {
            return footfalls.toe(leg, place, self.time_s(place));
        }
        let duration_s = place.share * self.request.step_duration_s;
        let middle_s = self.time_s(place) + (0.5 - place.phase) * duration_s;
        if is_stance {
            return self.under_the_body(leg, middle_s).push(0.0);
        }
        let [from, to] = [middle_s - duration_s, middle_s + duration_s].map(|t| self.under_the_body(leg, t));
        let (along, lift) = swing_arc(place.phase);
        from.lerp(&to, along).push(self.request.clearance_m * lift)
    }

    fn unreachable(&self, robot: &Robot, place: &Place, leg: usize, toe: Vector3<f64>) -> Unreachable {
        let t = self.time_s(place);
        let in_body = self.motion.rotation(t).transpose() * (toe.xy() - self.motion.displacement_m(t));
        Unreachable::new(robot, self.request, leg, in_body.push(toe.z), self.hip_x_m[leg])
    }

    /// A point's unknowns, its joints on the polynomials `fit`.
    fn put_point(
        &self,
        program: &FullOrderProgram,
        robot: &Robot,
        data: &mut Data,
        place: &Place,
        fit: &DMatrix<f64>,
        x: &mut [f64],
    ) {
        let t = self.time_s(place);
        let velocity_m_s = self.motion.velocity_m_s(t);
        let base_rate = [velocity_m_s.x, velocity_m_s.y, 0.0, 0.0, 0.0, self.motion.yaw_rate_rad_s];
        let duration_s = self.request.step_duration_s * place.share;
        put_point(program, robot, data, place, duration_s, [self.base(place), base_rate], |j, k| fit[(k, j)], x);
    }
}

/// A point's unknowns: the base and its rates, joints on polynomials whose coefficients are `coefficient(joint, k)`
/// over the domain's duration, the weight on the stance toes alike.
#[allow(clippy::too_many_arguments)]
pub(super) fn put_point(
    program: &FullOrderProgram,
    robot: &Robot,
    data: &mut Data,
    place: &Place,
    duration_s: f64,
    [base, base_rate]: [[f64; 6]; 2],
    coefficient: impl Fn(usize, usize) -> f64,
    x: &mut [f64],
) {
    let bases = [
        (bezier::basis(place.phase), 1.0),
        (bezier::basis_first_derivative(place.phase), duration_s),
        (bezier::basis_second_derivative(place.phase), duration_s * duration_s),
    ];
    let [mut q, mut v, a] = bases.map(|(basis, divisor)| {
        let mut w = [0.0; DOF];
        for j in 0..JOINTS {
            w[6 + j] = (0..COEFFICIENTS).map(|k| coefficient(j, k) * basis[k]).sum::<f64>() / divisor;
        }
        w
    });
    q[..6].copy_from_slice(&base);
    v[..6].copy_from_slice(&base_rate);
    let stance = &program.schedule.domains[place.domain].stance;
    let weight_n = robot.model.total_mass() * robot.model.gravity.norm();
    let force = Vector3::new(0.0, 0.0, weight_n / stance.len() as f64);
    let forces: Vec<_> = stance.iter().map(|&leg| (robot.legs[leg].toe, force)).collect();
    let tau = rnea(&robot.model, data, &q, &v, &a, &forces);
    let point = &mut x[program.schedule.columns(place)];
    point[at::Q..at::V].copy_from_slice(&q);
    point[at::V..at::A].copy_from_slice(&v);
    point[at::A..at::U].copy_from_slice(&a);
    point[at::U..at::LAMBDA].copy_from_slice(&tau.as_slice()[6..]);
    for toe in point[at::LAMBDA..].chunks_mut(3) {
        toe.copy_from_slice(force.as_slice());
    }
}

/// Puts the reference that leads along a start in place of its polynomials: where the law is to hold, it nearly does.
pub(super) fn put_reference(program: &FullOrderProgram, robot: &Robot, x: &mut [f64]) {
    let (schedule, t) = (&program.schedule, x[program.schedule.t()]);
    for (domain, d) in schedule.domains.iter().enumerate() {
        let reference = compensated_reference(robot, &program.plan_points(x, domain), t * d.share);
        for j in 0..JOINTS {
            for k in 0..COEFFICIENTS {
                x[schedule.alpha(domain, k, j)] = reference[j][k];
            }
        }
    }
}

/// Newton's method with damping from the leg's angles in `near`.
fn inverse_kinematics(
    robot: &Robot,
    data: &mut Data,
    leg: usize,
    base: [f64; 6],
    near: &[f64; JOINTS],
    target: Vector3<f64>,
) -> Option<[f64; 3]> {
    const TOLERANCE_M: f64 = 1e-9;
    const LONGEST_STEP_RAD: f64 = 0.3;
    let first = 6 + 3 * leg;
    let zero = [0.0; DOF];
    let mut q = zero;
    q[..6].copy_from_slice(&base);
    q[6..].copy_from_slice(near);
    for _ in 0..60 {
        let toe = point_kinematics(&robot.model, data, &q, &zero, &zero, robot.legs[leg].toe);
        let error = target - toe.position;
        if error.norm() < TOLERANCE_M {
            return Some([q[first], q[first + 1], q[first + 2]]);
        }
        let jacobian = toe.jacobian.fixed_columns::<3>(first).into_owned();
        let damped = jacobian.transpose() * jacobian + nalgebra::Matrix3::identity() * (1e-4 * error.norm_squared());
        let mut step = damped.try_inverse()? * jacobian.transpose() * error;
        let longest = step.amax();
        if longest > LONGEST_STEP_RAD {
            step *= LONGEST_STEP_RAD / longest;
        }
        for k in 0..3 {
            q[first + k] += step[k];
        }
    }
    None
}

/// The program's unknowns for the decomposed program's: the second step, where there is one, is the first one's mirror
/// image.
pub(crate) fn recomposed(full: &FullOrderProgram, program: &DecomposedProgram, x: &[f64]) -> Vec<f64> {
    use crate::program::layout as d;
    let schedule = &full.schedule;
    let pairing = program.bipeds.pairing();
    let mut out = vec![0.0; schedule.unknowns];
    for k in 0..COEFFICIENTS {
        let mut front = [0.0; 12];
        for j in 0..6 {
            front[6 + j] = x[d::alpha(k, j)];
        }
        let all = pairing.recompose_position(&front);
        out[schedule.alpha(0, k, 0)..schedule.alpha(0, k + 1, 0)].copy_from_slice(&all[6..]);
    }
    out[schedule.t()] = x[d::T];
    for place in schedule.places_of(0) {
        let from = &x[d::point(place.point)..d::point(place.point + 1)];
        let twelve = |start: usize| -> [f64; 12] { from[start..start + 12].try_into().expect("twelve entries") };
        let to = &mut out[schedule.columns(place)];
        to[at::Q..at::V].copy_from_slice(&pairing.recompose_position(&twelve(d::Q)));
        to[at::V..at::A].copy_from_slice(&pairing.recompose_rate(&twelve(d::V)));
        to[at::A..at::U].copy_from_slice(&pairing.recompose_rate(&twelve(d::A)));
        for j in 0..3 {
            to[at::U + j] = from[d::U_FRONT + j];
            to[at::U + 3 + j] = from[d::U_REAR + j];
            to[at::U + 6 + j] = from[d::U_FRONT + 3 + j];
            to[at::U + 9 + j] = from[d::U_REAR + 3 + j];
        }
        to[at::LAMBDA..].copy_from_slice(&from[d::LAMBDA_1..d::LAMBDA_1 + 6]);
    }
    if schedule.domains.len() == 2 {
        mirror_second_step(full, program.speed_m_s, &mut out);
    }
    out
}

/// Fills the second step with the mirror image of the first.
fn mirror_second_step(full: &FullOrderProgram, speed_m_s: f64, x: &mut [f64]) {
    let (schedule, mirror) = (&full.schedule, &full.robot.mirror);
    for k in 0..COEFFICIENTS {
        for i in 6..DOF {
            let (from, sign) = mirror.coordinate_source(i);
            x[schedule.alpha(1, k, i - 6)] = sign * x[schedule.alpha(0, k, from - 6)];
        }
    }
    let length_m = speed_m_s * x[schedule.t()];
    for (first, second) in schedule.places_of(0).iter().zip(schedule.places_of(1)) {
        let first = x[schedule.columns(first)].to_vec();
        let second = &mut x[schedule.columns(second)];
        mirror_point(&full.robot, &first, second);
        second[at::Q] += length_m;
    }
}
