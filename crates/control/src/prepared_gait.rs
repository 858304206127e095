//! A gait made ready for the control cycle: checked against this robot, and free of anything on the heap.

use crate::balance_config::BalanceConfig;
use crate::prepared_domain::{self, Cycle, Polynomials, PreparedDomain, compensation};
use crate::step::{LEAD_STEPS, Step};
use crate::{Config, JOINTS, of_leg};
use gait::{Coefficients, Gait, GaitError, LEGS, Mirror, StepSide, bezier};
use nalgebra::Vector3;

/// A lead whose joints all move slower than this where it begins is one out of standing; a walk's own are ten times as
/// fast at its switches.
const REST_RAD_S: f64 = 0.02;

/// Phases at which a gait is checked before it is accepted.
const CHECKED_PHASES: usize = 101;

/// Where a gait's request says which ground it is planned for, ahead and to the left, and the steepest, rad.
const SLOPES: [&str; 2] = ["slope_rad", "sideways_slope_rad"];
const STEEPEST_RAD: f64 = 0.35;

/// Phases of each step at which the room of its toes is looked for.
const ROOM_PHASES: usize = 20;
/// Of that room, kept for placing the toes: this share of the leg's length.
const PLACEMENT_RESERVE_SHARE: f64 = 0.02;

/// The largest length up to `most` that is `reached`, to a 2000th of it.
fn furthest(most: f64, reached: impl Fn(f64) -> bool) -> f64 {
    let (mut low, mut high) = (0.0, most);
    for _ in 0..11 {
        let middle = 0.5 * (low + high);
        if reached(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

/// A gait that this robot may walk. `Copy`, so that it can go through a wait-free buffer into the control cycle and be
/// replaced there without freeing memory.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PreparedGait {
    name: GaitName,
    step_duration_s: f64,
    planned_rad: [Coefficients; JOINTS],
    /// Reference minus plan.
    compensation_rad: [Coefficients; JOINTS],
    mirror: Mirror,
    /// The second step's own polynomials, where it is no mirror image of the first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    second: Option<Polynomials>,
    /// The two steps that are walked once before the first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    lead: Option<[PreparedDomain; LEAD_STEPS]>,
    /// What is walked over and over in place of the two steps.
    #[serde(default = "prepared_domain::no_cycle", skip_serializing_if = "prepared_domain::is_no_cycle")]
    cycle: Cycle,
    kp: [f64; JOINTS],
    kd: [f64; JOINTS],
    /// Rise over run, ahead and to the left, of the ground that it is planned for.
    #[serde(default)]
    rise: [f64; 2],
    /// How far each toe may be shifted to the right (negative) and to the left, m, so that its leg still reaches all of
    /// the gait; none where nothing shifts them, and in recordings that are older.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    lateral_room_m: Option<[[f64; 2]; 4]>,
}

/// Rise over run of the ground that a gait is planned for; else the field and what is wrong.
fn planned_rise(gait: &Gait) -> Result<[f64; 2], GaitError> {
    let mut rise = [0.0; 2];
    for (key, rise) in SLOPES.into_iter().zip(&mut rise) {
        // The balanced law moves the body by it. Gaits that are older say nothing of it, and are for level ground.
        let slope = &gait.request[key];
        match slope.as_f64().or(slope.is_null().then_some(0.0)) {
            Some(slope_rad) if slope_rad.abs() <= STEEPEST_RAD => *rise = slope_rad.tan(),
            _ => {
                let problem = format!("is {slope}, expected {} to {STEEPEST_RAD} rad", -STEEPEST_RAD);
                return Err(GaitError::Value { gait: gait.name.clone(), field: format!("request.{key}"), problem });
            }
        }
    }
    Ok(rise)
}

/// One instant of a gait.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instant {
    /// Planned positions B, rad.
    pub position_rad: [f64; JOINTS],
    /// Planned velocities Ḃ, rad/s.
    pub velocity_rad_s: [f64; JOINTS],
    /// kp (B̃ − B) + kd (dB̃/dt − Ḃ), N m: what the compensated reference B̃ adds to the law on the planned joints.
    pub torque_nm: [f64; JOINTS],
}

impl PreparedGait {
    /// Checks `gait` against the robot of `config`: its name, joints, position, velocity and torque limits, and gains.
    pub fn new(gait: &Gait, config: &Config) -> Result<Self, GaitError> {
        gait.validate()?;
        gait.check_robot(&config.robot, &config.joint_names)?;
        let refuse = |field: String, problem: String| Err(GaitError::Value { gait: gait.name.clone(), field, problem });
        if !gait.solver.is_solution() {
            return refuse(
                "solver.status".into(),
                format!("is \"{}\", expected \"converged\" or \"acceptable\": plan it again", gait.solver.status),
            );
        }
        for j in 0..JOINTS {
            // A drive's law with gains far from those the robot was set up with is not stable.
            for (key, value, usual) in [
                ("gains.kp", gait.gains.kp[j], config.posture_kp[j]),
                ("gains.kd", gait.gains.kd[j], config.posture_kd[j]),
            ] {
                if !(0.1 * usual..=4.0 * usual).contains(&value) {
                    return refuse(
                        format!("{key}[{j}]"),
                        format!("is {value}, this robot allows {} to {}", 0.1 * usual, 4.0 * usual),
                    );
                }
            }
        }
        if config.balance.is_some() {
            prepared_domain::check_balanced(gait)?;
        }
        let mut prepared = Self {
            name: GaitName::new(&gait.name),
            step_duration_s: gait.step_duration_s,
            planned_rad: gait.coefficients_rad,
            compensation_rad: compensation(&gait.reference_coefficients_rad, &gait.coefficients_rad),
            mirror: gait.mirror,
            second: gait
                .second_step
                .as_ref()
                .map(|second| Polynomials::new(&second.coefficients_rad, &second.reference_coefficients_rad)),
            lead: prepared_domain::lead(gait)?,
            cycle: prepared_domain::cycle(gait),
            kp: gait.gains.kp,
            kd: gait.gains.kd,
            rise: planned_rise(gait)?,
            lateral_room_m: None,
        };
        prepared.check_limits(gait, config)?;
        let sharing = config.balance.as_ref().filter(|balance| balance.pairs_share_shift);
        prepared.lateral_room_m = sharing.map(|balance| prepared.lateral_room(balance));
        Ok(prepared)
    }

    /// The steps that are walked, the lead's first.
    fn steps(&self) -> impl Iterator<Item = Step> {
        let lead = (0..LEAD_STEPS).map(Step::Lead).filter(|_| self.has_lead());
        lead.chain((0..self.stride_steps()).map(Step::Cycle))
    }

    /// Steps of a stride, over which the gait repeats: the trot's two, or the domains of its cycle.
    pub fn stride_steps(&self) -> usize {
        match self.cycle.iter().take_while(|domain| domain.is_some()).count() {
            0 => StepSide::BOTH.len(),
            domains => domains,
        }
    }

    /// Whether its stride is a cycle of domains, which may differ in duration, and not the trot's two steps.
    pub fn has_cycle(&self) -> bool {
        self.cycle[0].is_some()
    }

    /// Which legs stand in a step; the others swing.
    pub fn stands(&self, step: Step) -> [bool; LEGS] {
        let (Step::Lead(index) | Step::Cycle(index)) = step;
        self.domain(step).map_or_else(|| StepSide::of_step(index as u64).stands(), |domain| domain.stands)
    }

    /// Whether the same legs stand in the steps of both strides, one after the other.
    pub fn has_schedule_of(&self, other: &Self) -> bool {
        let steps = self.stride_steps();
        let same = |index: usize| self.stands(Step::Cycle(index)) == other.stands(Step::Cycle(index));
        steps == other.stride_steps() && (0..steps).all(same)
    }

    /// Middle of the postures in which the stride's steps begin, or the lead's: joints, rad.
    pub fn middle_rad(&self, of_lead: bool) -> [f64; JOINTS] {
        let (step, count): (fn(usize) -> Step, _) =
            if of_lead { (Step::Lead, LEAD_STEPS) } else { (Step::Cycle, self.stride_steps()) };
        let mut sum = self.at_step(step(0), 0.0).position_rad;
        for index in 1..count {
            let begins = self.at_step(step(index), 0.0).position_rad;
            sum.iter_mut().zip(begins).for_each(|(sum, begins)| *sum += begins);
        }
        sum.map(|sum| sum / count as f64)
    }

    /// Whether all that is planned is within the robot's limits.
    fn check_limits(&self, gait: &Gait, config: &Config) -> Result<(), GaitError> {
        for n in 0..CHECKED_PHASES {
            let s = n as f64 / (CHECKED_PHASES - 1) as f64;
            for step in self.steps() {
                let at = self.at_step(step, s);
                let of = if step.is_lead() { "the lead's planned" } else { "planned" };
                for j in 0..JOINTS {
                    for (what, unit, value, low, high) in [
                        ("position", "rad", at.position_rad[j], config.position_min_rad[j], config.position_max_rad[j]),
                        (
                            "velocity",
                            "rad/s",
                            at.velocity_rad_s[j],
                            -config.velocity_limit_rad_s[j],
                            config.velocity_limit_rad_s[j],
                        ),
                        ("torque", "N m", at.torque_nm[j], -config.torque_limit_nm[j], config.torque_limit_nm[j]),
                    ] {
                        if !(low..=high).contains(&value) {
                            return Err(GaitError::Value {
                                gait: gait.name.clone(),
                                field: format!("{of} {what} of {}", gait.joint_names[j]),
                                problem: format!(
                                    "is {value:.4} {unit} at phase {s}, this robot allows {low} to {high}"
                                ),
                            });
                        }
                    }
                }
            }
        }
        Ok(())
    }

    /// How far each toe may be shifted to either side: see the field.
    fn lateral_room(&self, balance: &BalanceConfig) -> [[f64; 2]; 4] {
        let phases = (0..=ROOM_PHASES).map(|n| n as f64 / ROOM_PHASES as f64);
        let instants: Vec<_> =
            phases.flat_map(|s| self.steps().map(move |step| self.at_step(step, s).position_rad)).collect();
        std::array::from_fn(|leg| {
            let kinematics = &balance.legs[leg];
            let toes: Vec<_> = instants.iter().map(|at| kinematics.toe_m(&of_leg(at, leg))).collect();
            let reached = |shift_m: f64| {
                toes.iter().all(|toe| !kinematics.joints(&(toe + Vector3::new(0.0, shift_m, 0.0))).limited)
            };
            let reserve_m = PLACEMENT_RESERVE_SHARE * kinematics.length_m();
            [-1.0, 1.0].map(|side| side * (furthest(kinematics.length_m(), |m| reached(side * m)) - reserve_m).max(0.0))
        })
    }

    /// How far each toe may be shifted to the right (negative) and to the left, m; none: it is not known.
    pub fn lateral_room_m(&self) -> Option<&[[f64; 2]; 4]> {
        self.lateral_room_m.as_ref()
    }

    /// Rise over run, ahead and to the left, of the ground that it is planned for.
    pub fn rise(&self) -> [f64; 2] {
        self.rise
    }

    /// The trot at phase `s` ∈ [0, 1] of one of its two steps.
    pub fn at(&self, side: StepSide, s: f64) -> Instant {
        self.at_step(Step::Cycle(side as usize), s)
    }

    /// The gait at phase `s` ∈ [0, 1] of a step. Does not allocate.
    pub fn at_step(&self, step: Step, s: f64) -> Instant {
        let (value, slope) = (bezier::basis(s), bezier::basis_first_derivative(s));
        let rate = 1.0 / self.duration_s(step);
        let own = self.own_polynomials(step);
        let (planned_rad, compensation_rad) =
            own.map_or((&self.planned_rad, &self.compensation_rad), |own| (&own.planned_rad, &own.compensation_rad));
        let planned: [(f64, f64); JOINTS] = std::array::from_fn(|j| {
            let c = &planned_rad[j];
            (bezier::combine(c, &value), bezier::combine(c, &slope) * rate)
        });
        let torque: [f64; JOINTS] = std::array::from_fn(|j| {
            let c = &compensation_rad[j];
            self.kp[j] * bezier::combine(c, &value) + self.kd[j] * bezier::combine(c, &slope) * rate
        });
        let (position_rad, velocity_rad_s) = (planned.map(|p| p.0), planned.map(|p| p.1));
        if !self.is_mirror_image(step) {
            return Instant { position_rad, velocity_rad_s, torque_nm: torque };
        }
        Instant {
            position_rad: self.mirror.apply(&position_rad),
            velocity_rad_s: self.mirror.apply(&velocity_rad_s),
            torque_nm: self.mirror.apply(&torque),
        }
    }

    /// The gait's name; longer names are cut.
    pub fn name(&self) -> GaitName {
        self.name
    }

    /// How long a step takes, s: T, or the domain's own.
    pub fn duration_s(&self, step: Step) -> f64 {
        self.domain(step).map_or(self.step_duration_s, |domain| domain.duration_s)
    }

    /// Whether two planned steps lead into it, out of standing or out of another gait.
    pub fn has_lead(&self) -> bool {
        self.lead.is_some()
    }

    /// Whether a walk out of standing begins with the lead: with one that begins at rest.
    pub fn leads_out_of_standing(&self) -> bool {
        self.has_lead() && self.at_step(Step::Lead(0), 0.0).velocity_rad_s.iter().all(|rate| rate.abs() < REST_RAD_S)
    }

    /// What is walked in a step that is none of the trot's two.
    fn domain(&self, step: Step) -> Option<&PreparedDomain> {
        match step {
            Step::Lead(index) => self.lead.as_ref()?.get(index),
            Step::Cycle(index) => self.cycle.get(index)?.as_ref(),
        }
    }

    /// The polynomials of a step that are not the first step's.
    fn own_polynomials(&self, step: Step) -> Option<&Polynomials> {
        match (self.domain(step), step) {
            (Some(domain), _) => Some(&domain.polynomials),
            (None, Step::Cycle(1)) => self.second.as_ref(),
            (None, _) => None,
        }
    }

    /// Whether a step is the first one's mirror image.
    fn is_mirror_image(&self, step: Step) -> bool {
        step == Step::Cycle(1) && self.own_polynomials(step).is_none()
    }

    /// Position gains in a step, N m / rad.
    pub fn kp(&self, step: Step) -> [f64; JOINTS] {
        self.gains(&self.kp, step)
    }

    /// Velocity gains in a step, N m s / rad.
    pub fn kd(&self, step: Step) -> [f64; JOINTS] {
        self.gains(&self.kd, step)
    }

    /// The mirrored step's torques are the first step's on the other side, and so are the gains that give them. A step
    /// of its own has its reference made for the joints' own gains.
    fn gains(&self, gains: &[f64; JOINTS], step: Step) -> [f64; JOINTS] {
        if !self.is_mirror_image(step) {
            return *gains;
        }
        std::array::from_fn(|j| gains[self.mirror.source(j).0])
    }
}

/// A gait's name without the heap: at most 48 bytes of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(into = "String", from = "String")]
pub struct GaitName {
    bytes: [u8; 48],
    length: u8,
}

impl GaitName {
    fn new(name: &str) -> Self {
        let mut bytes = [0; 48];
        let mut length = 0;
        for c in name.chars() {
            if length + c.len_utf8() > bytes.len() {
                break;
            }
            c.encode_utf8(&mut bytes[length..]);
            length += c.len_utf8();
        }
        Self { bytes, length: length as u8 }
    }

    /// The name.
    pub fn as_str(&self) -> &str {
        // Only whole characters were written.
        std::str::from_utf8(&self.bytes[..self.length as usize]).unwrap_or("")
    }
}

impl From<GaitName> for String {
    fn from(name: GaitName) -> Self {
        name.as_str().to_owned()
    }
}

impl From<String> for GaitName {
    fn from(name: String) -> Self {
        Self::new(&name)
    }
}
