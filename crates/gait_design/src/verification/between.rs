//! What a plan does between the points of its program.

use super::step_of;
use crate::PlanError;
use crate::planar::PlanarMotion;
use crate::recompose::PlanPoint;
use crate::refine::integral;
use crate::request::GaitRequest;
use crate::tolerance::Tolerances;
use gait::{Domain, Gait, JOINTS, LEGS, StepSide};
use nalgebra::Vector3;
use rigid_body::{Data, rnea};
use robot::Robot;

/// Samples of an interval of the program, which has a point in its middle, beside its start. With a parabola through
/// each peak they find what twenty times as many do to a thousandth.
const SAMPLES: usize = 10;

/// What a plan's motion does between the program's points: positions, velocities, accelerations and forces by the
/// interpolants that Hermite–Simpson collocation stands for, torques by the full-order inverse dynamics. Each number is
/// the largest on a grid five times finer and of the parabolas through its peaks there.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BetweenPoints {
    /// How far a stance toe is from where it stood, m.
    pub stance_slip_m: f64,
    /// How far a swing toe is below the floor, m.
    pub swing_below_floor_m: f64,
    /// How far a joint's polynomial is outside the joint's range, rad.
    pub joint_range_rad: f64,
    /// How far a joint is from its polynomial, rad; 0 where it is not held to it.
    pub polynomial_rad: f64,
    /// How much faster than its limit a joint's polynomial moves, rad/s: hip roll, hip pitch, knee.
    pub joint_velocity_rad_s: [f64; 3],
    /// How far a torque is above its bound, N m: hip roll, hip pitch, knee.
    pub torque_nm: [f64; 3],
    /// How far a ground force is outside its friction pyramid or below its smallest normal force, N.
    pub ground_force_n: f64,
    /// Force or moment by which the base is out of balance, N or N m.
    pub imbalance: f64,
    /// What counts as kept.
    pub tolerances: Tolerances,
}

impl BetweenPoints {
    /// Whether the plan may be walked: all within the tolerances.
    pub fn is_kept(&self) -> bool {
        self.broken().is_empty()
    }

    /// Refuses a plan that breaks something between its `points`.
    pub(crate) fn check(&self, points: usize) -> Result<(), PlanError> {
        let broken = self.broken();
        if broken.is_empty() {
            return Ok(());
        }
        Err(PlanError::Unverified(format!("between the program's {points} points {}", broken.join(", "))))
    }

    /// What is broken, each with its amount and what is allowed. Written so that NaN counts as broken.
    pub fn broken(&self) -> Vec<String> {
        let t = &self.tolerances;
        let [roll, pitch, knee] = [0, 1, 2];
        [
            ("stance toes slip", self.stance_slip_m, t.length_m, "m"),
            ("swing toes are below the floor", self.swing_below_floor_m, t.length_m, "m"),
            ("joints leave their range", self.joint_range_rad, 0.0, "rad"),
            ("joints depart from their polynomials", self.polynomial_rad, t.angle_rad, "rad"),
            ("hip rolls are too fast", self.joint_velocity_rad_s[roll], 0.0, "rad/s"),
            ("hip pitches are too fast", self.joint_velocity_rad_s[pitch], 0.0, "rad/s"),
            ("knees are too fast", self.joint_velocity_rad_s[knee], 0.0, "rad/s"),
            ("hip roll torques are too large", self.torque_nm[roll], t.torque_nm[roll], "N m"),
            ("hip pitch torques are too large", self.torque_nm[pitch], t.torque_nm[pitch], "N m"),
            ("knee torques are too large", self.torque_nm[knee], t.torque_nm[knee], "N m"),
            ("ground forces leave their limits", self.ground_force_n, t.force_n, "N"),
        ]
        .into_iter()
        .filter(|(_, amount, allowed, _)| amount.is_nan() || amount > allowed)
        .map(|(what, amount, allowed, unit)| format!("{what} by {amount:.2e} {unit} (at most {allowed:.2e})"))
        .collect()
    }
}

/// What is looked at in a sample: how far each number is beyond its limit, 0 of legs that it does not concern.
#[derive(Clone, Copy)]
struct Sample {
    imbalance: f64,
    stance_slip_m: [f64; LEGS],
    swing_below_floor_m: [f64; LEGS],
    ground_force_n: [f64; LEGS],
    joint_range_rad: [f64; JOINTS],
    polynomial_rad: [f64; JOINTS],
    joint_velocity_rad_s: [f64; JOINTS],
    torque_nm: [f64; JOINTS],
}

/// Numbers of a [`Sample`].
const NUMBERS: usize = OF_LEGS + 4 * JOINTS;
/// Those before the joints'.
const OF_LEGS: usize = 1 + 3 * LEGS;

impl Sample {
    fn numbers(&self) -> [f64; NUMBERS] {
        let mut numbers = [self.imbalance; NUMBERS];
        let mut rest = &mut numbers[1..];
        for part in [&self.stance_slip_m[..], &self.swing_below_floor_m, &self.ground_force_n].into_iter().chain([
            &self.joint_range_rad[..],
            &self.polynomial_rad,
            &self.joint_velocity_rad_s,
            &self.torque_nm,
        ]) {
            let (here, after) = rest.split_at_mut(part.len());
            here.copy_from_slice(part);
            rest = after;
        }
        numbers
    }

    fn of(numbers: &[f64; NUMBERS]) -> Self {
        let (small, joints) = numbers.split_at(OF_LEGS);
        let (four, twelve) = (small[1..].as_chunks::<LEGS>().0, joints.as_chunks::<JOINTS>().0);
        Self {
            imbalance: numbers[0],
            stance_slip_m: four[0],
            swing_below_floor_m: four[1],
            ground_force_n: four[2],
            joint_range_rad: twelve[0],
            polynomial_rad: twelve[1],
            joint_velocity_rad_s: twelve[2],
            torque_nm: twelve[3],
        }
    }
}

/// The larger of two numbers; what is none is larger than all, and so is seen at the end.
fn larger(a: f64, b: f64) -> f64 {
    if a.is_nan() || b <= a { a } else { b }
}

/// The largest values of numbers that are sampled at equal distances.
struct Peaks {
    largest: [f64; NUMBERS],
    /// The last two samples of the curve at hand.
    last: [[f64; NUMBERS]; 2],
    known: usize,
}

impl Peaks {
    /// None is below zero: what is within its limit is no excess.
    fn new() -> Self {
        Self { largest: [0.0; NUMBERS], last: [[0.0; NUMBERS]; 2], known: 0 }
    }

    /// The next sample, of a curve that is smooth since the last corner.
    fn add(&mut self, now: [f64; NUMBERS]) {
        let Self { largest, last: [before, middle], known } = self;
        for i in 0..NUMBERS {
            let (a, b, c) = (before[i], middle[i], now[i]);
            let bend = (b - a) + (b - c);
            let is_peak = *known >= 2 && b >= a && b >= c && bend > 0.0;
            let peak = if is_peak { b + (c - a) * (c - a) / (8.0 * bend) } else { c };
            largest[i] = larger(largest[i], if peak > c { peak } else { c });
        }
        self.last = [*middle, now];
        self.known += 1;
    }

    /// The last sample is a corner.
    fn corner(&mut self) {
        self.known = 1;
    }
}

/// Takes samples of one plan.
struct Sampler<'a> {
    robot: &'a Robot,
    request: &'a GaitRequest,
    planned: DomainPlan<'a>,
    data: Data,
    /// Where the toes were in the first sample.
    stood: Option<[Vector3<f64>; LEGS]>,
    motion: PlanarMotion,
    normal_force_min_n: f64,
    friction_face: f64,
}

impl<'a> Sampler<'a> {
    fn new(robot: &'a Robot, request: &'a GaitRequest, planned: DomainPlan<'a>) -> Self {
        let share = crate::ProgramSettings::default().normal_force_min_share;
        Self {
            robot,
            request,
            planned,
            data: Data::new(&robot.model),
            stood: None,
            motion: PlanarMotion::of(request),
            normal_force_min_n: share * robot.model.total_mass() * 9.81,
            friction_face: request.friction / std::f64::consts::SQRT_2,
        }
    }

    /// At share `s` of the interval between three points, which takes `h` seconds.
    fn sample(&mut self, [p0, p1, p2]: [&PlanPoint; 3], s: f64, h: f64) -> Sample {
        // Weights of the three values in the quadratic through them at s and in its integral from 0.
        let value = [(1.0 - s) * (1.0 - 2.0 * s), 4.0 * s * (1.0 - s), s * (2.0 * s - 1.0)];
        let integral = integral(s).map(|w| h * w);
        let weighed = |w: [f64; 3], f: [f64; 3]| w[0] * f[0] + w[1] * f[1] + w[2] * f[2];
        let q: [f64; 18] = std::array::from_fn(|i| p0.q[i] + weighed(integral, [p0.v[i], p1.v[i], p2.v[i]]));
        let v: [f64; 18] = std::array::from_fn(|i| p0.v[i] + weighed(integral, [p0.a[i], p1.a[i], p2.a[i]]));
        let a: [f64; 18] = std::array::from_fn(|i| weighed(value, [p0.a[i], p1.a[i], p2.a[i]]));
        let Self { robot, request, data, .. } = self;
        let (stands, joints_prescribed) = (self.planned.domain.stands, self.planned.joints_prescribed);
        let force: [Vector3<f64>; LEGS] = std::array::from_fn(|leg| {
            let of = |k: usize| [p0, p1, p2].map(|p| p.ground_force_n[leg][k]);
            Vector3::from_fn(|k, _| weighed(value, of(k)))
        });
        let mut forces = [(robot.legs[0].toe, Vector3::zeros()); LEGS];
        let mut standing = 0;
        for leg in (0..LEGS).filter(|leg| stands[*leg]) {
            forces[standing] = (robot.legs[leg].toe, force[leg]);
            standing += 1;
        }
        let tau = rnea(&robot.model, data, &q, &v, &a, &forces[..standing]);
        let imbalance = tau.rows(0, 6).amax();
        let tau: [f64; JOINTS] = std::array::from_fn(|j| tau[6 + j]);
        let toes: [Vector3<f64>; LEGS] =
            std::array::from_fn(|leg| rigid_body::frame_position(&robot.model, data, robot.legs[leg].toe));
        let start = *self.stood.get_or_insert(toes);
        let phase = p0.phase + s * (p2.phase - p0.phase);
        let (planned, planned_velocity) = self.planned.domain.planned(phase);
        // The controller walks polynomials, and none that is beyond a limit.
        let beyond = |j: usize| {
            let leg = &robot.legs[j / 3];
            (leg.position_min_rad[j % 3] - planned[j]).max(planned[j] - leg.position_max_rad[j % 3])
        };
        // The pyramid turns with the robot, as in the program.
        let time = self.planned.before + self.planned.share * phase;
        let axes = self.motion.rotation(time * request.step_duration_s);
        let outside = |f: &Vector3<f64>| {
            let needed = axes.tr_mul(&f.xy()).amax() - self.friction_face * f.z;
            needed.max(self.normal_force_min_n - f.z)
        };
        let departs = |q: f64, planned: f64| if joints_prescribed { (q - planned).abs() } else { 0.0 };
        let of_legs = |stand: bool, value: &dyn Fn(usize) -> f64| -> [f64; LEGS] {
            std::array::from_fn(|leg| if stands[leg] == stand { value(leg) } else { 0.0 })
        };
        Sample {
            imbalance,
            stance_slip_m: of_legs(true, &|leg| (toes[leg] - start[leg]).norm()),
            swing_below_floor_m: of_legs(false, &|leg| -toes[leg].z),
            ground_force_n: of_legs(true, &|leg| outside(&force[leg])),
            joint_range_rad: std::array::from_fn(beyond),
            polynomial_rad: std::array::from_fn(|j| departs(q[6 + j], planned[j])),
            joint_velocity_rad_s: std::array::from_fn(|j| {
                planned_velocity[j].abs() - robot.limits.velocity_rad_s[j % 3]
            }),
            torque_nm: std::array::from_fn(|j| tau[j].abs() - request.torque_limit_nm[j % 3]),
        }
    }
}

/// Looks at a plan between its points. For a plan on a slope, `robot` is [`crate::on_slope`]'s.
pub fn between_points(robot: &Robot, request: &GaitRequest, gait: &Gait, points: &[PlanPoint]) -> BetweenPoints {
    between_points_by(robot, request, gait, points, SAMPLES)
}

/// [`between_points`] by so many samples of each interval.
fn between_points_by(
    robot: &Robot,
    request: &GaitRequest,
    gait: &Gait,
    points: &[PlanPoint],
    samples: usize,
) -> BetweenPoints {
    let (side, ..) = step_of(points);
    let domain = &gait.steps()[side as usize];
    let before = if side == StepSide::First { 0.0 } else { 1.0 };
    between_by(robot, request, DomainPlan { domain, before, share: 1.0, points, joints_prescribed: true }, samples)
}

/// What was planned of a domain.
#[derive(Clone, Copy)]
pub(crate) struct DomainPlan<'a> {
    pub domain: &'a Domain,
    /// Duration of what comes before it over T.
    pub before: f64,
    /// Its own duration over T.
    pub share: f64,
    pub points: &'a [PlanPoint],
    /// Whether the joints are to be on their polynomials, or where the law about a planned reference leads them.
    pub joints_prescribed: bool,
}

/// Looks at a domain of any stance legs between its points. For a plan on a slope, `robot` is [`crate::on_slope`]'s.
pub(crate) fn between_points_of_domain(robot: &Robot, request: &GaitRequest, planned: DomainPlan) -> BetweenPoints {
    between_by(robot, request, planned, SAMPLES)
}

fn between_by(robot: &Robot, request: &GaitRequest, planned: DomainPlan, samples: usize) -> BetweenPoints {
    let points = planned.points;
    let h = 2.0 * planned.domain.duration_s / (points.len() - 1) as f64;
    let mut sampler = Sampler::new(robot, request, planned);
    let mut peaks = Peaks::new();
    for three in points.windows(3).step_by(2) {
        let three = [&three[0], &three[1], &three[2]];
        if peaks.known == 0 {
            peaks.add(sampler.sample(three, 0.0, h).numbers());
        }
        peaks.corner();
        for part in 1..=samples {
            peaks.add(sampler.sample(three, part as f64 / samples as f64, h).numbers());
        }
    }
    let largest = Sample::of(&peaks.largest);
    let largest_of = |numbers: &[f64]| numbers.iter().copied().fold(0.0, larger);
    let by_type = |numbers: &[f64; JOINTS]| {
        std::array::from_fn(|k| largest_of(&[numbers[k], numbers[3 + k], numbers[6 + k], numbers[9 + k]]))
    };
    BetweenPoints {
        stance_slip_m: largest_of(&largest.stance_slip_m),
        swing_below_floor_m: largest_of(&largest.swing_below_floor_m),
        joint_range_rad: largest_of(&largest.joint_range_rad),
        polynomial_rad: largest_of(&largest.polynomial_rad),
        joint_velocity_rad_s: by_type(&largest.joint_velocity_rad_s),
        torque_nm: by_type(&largest.torque_nm),
        ground_force_n: largest_of(&largest.ground_force_n),
        imbalance: largest.imbalance,
        tolerances: Tolerances::of(robot, request.torque_limit_nm),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{as_steps, go_on, vision60};

    #[test]
    fn a_plan_with_a_value_that_is_no_number_is_broken() {
        let robot = vision60();
        let request = as_steps("amble", &robot);
        let plan = crate::plan(&robot, &request, &Default::default(), go_on).unwrap();
        assert!(between_points(&robot, &request, &plan.gait, &plan.points).is_kept());
        for spoil in [
            |point: &mut PlanPoint| point.q[8] = f64::NAN,
            |point: &mut PlanPoint| point.v[8] = f64::NAN,
            |point: &mut PlanPoint| point.a[8] = f64::NAN,
            |point: &mut PlanPoint| point.ground_force_n.iter_mut().for_each(|force| force[2] = f64::NAN),
        ] {
            let mut points = plan.points.clone();
            spoil(&mut points[4]);
            let found = between_points(&robot, &request, &plan.gait, &points);
            assert!(!found.is_kept(), "{found:?}");
        }
    }

    #[test]
    fn what_is_broken_between_two_samples_is_seen() {
        let robot = vision60();
        for name in crate::behaviours() {
            let request = as_steps(name, &robot);
            let plan = crate::plan(&robot, &request, &Default::default(), go_on).unwrap();
            // Limits in the middle of what the plan does: every excess is one.
            let mut tight = request.clone();
            (tight.torque_limit_nm, tight.friction) = ([1.0; 3], 0.01);
            let mut narrow = robot.clone();
            narrow.limits.velocity_rad_s = [0.0; 3];
            for leg in &mut narrow.legs {
                (leg.position_min_rad, leg.position_max_rad) = (leg.stand_rad, leg.stand_rad);
            }
            let by = |samples| between_points_by(&narrow, &tight, &plan.gait, &plan.points, samples);
            let (found, fine) = (by(SAMPLES), by(200));
            let numbers = |b: &BetweenPoints| {
                let mut numbers = vec![b.joint_range_rad, b.ground_force_n];
                numbers.extend(b.joint_velocity_rad_s);
                numbers.extend(b.torque_nm);
                numbers
            };
            for (found, fine) in numbers(&found).into_iter().zip(numbers(&fine)) {
                assert!(fine > 0.0 && (found / fine - 1.0).abs() < 1e-3, "{name}: {found} instead of {fine}");
            }
            let allowed = found.tolerances;
            for (found, fine, allowed) in [
                (found.stance_slip_m, fine.stance_slip_m, allowed.length_m),
                (found.swing_below_floor_m, fine.swing_below_floor_m, allowed.length_m),
                (found.polynomial_rad, fine.polynomial_rad, allowed.angle_rad),
            ] {
                assert!((found - fine).abs() < 1e-2 * allowed, "{name}: {found} instead of {fine}");
            }
        }
    }
}
