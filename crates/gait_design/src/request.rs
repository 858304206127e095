//! What is asked of the planner.

use robot::Robot;
use serde::{Deserialize, Serialize};

/// A gait request, complete: every value stated. Start from [`GaitRequest::named`] and change what you need.
///
/// Ranges that no walking robot of this kind needs to exceed are refused by [`GaitRequest::validate`]; within them the
/// solver decides.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GaitRequest {
    /// Name of the behaviour, carried into the gait file.
    pub behaviour: String,
    /// T, s; held to within [`GaitRequest::STEP_DURATION_TOLERANCE`].
    pub step_duration_s: f64,
    /// How high the swing toes rise in the middle of the step, m.
    pub clearance_m: f64,
    /// Forward speed, m/s; negative is backward.
    pub speed_m_s: f64,
    /// Speed to the left, m/s; negative is to the right. Other than 0 two steps are planned, by the full-order program
    /// ([`crate::plan_full_order`]).
    #[serde(default, skip_serializing_if = "is_zero")]
    pub lateral_speed_m_s: f64,
    /// Yaw rate, rad/s; positive turns to the left. Speeds are in axes that turn along. Other than 0 two steps are
    /// planned, on level ground only: on a slope a turning gait does not repeat.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub yaw_rate_rad_s: f64,
    /// Hip axes above the toe centres, m.
    pub height_m: f64,
    /// Lateral distance of a stance toe from the mid plane, m.
    pub half_width_m: f64,
    /// Slope of the ground along the walk, rad; positive is uphill.
    pub slope_rad: f64,
    /// Slope of the ground across the walk, rad; positive rises to the left. The mirror does not hold there: two steps
    /// are planned ([`crate::plan_full_order`]).
    #[serde(default, skip_serializing_if = "is_zero")]
    pub sideways_slope_rad: f64,
    /// Pitch that the torso is held at, rad; positive lowers its nose. Other than 0 it takes the full-order program,
    /// whose rear legs are not tied to the front ones.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub torso_pitch_rad: f64,
    /// Roll that the torso is held at, rad; positive lowers its right side. The mirror does not hold there: two steps
    /// are planned.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub torso_roll_rad: f64,
    /// Friction coefficient that the ground forces may use.
    pub friction: f64,
    /// Torque bound of (hip roll, hip pitch, knee), N m, on all four legs.
    pub torque_limit_nm: [f64; 3],
}

/// So that a request without these is written as it was before they came.
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// The names of the contact schedules.
pub(crate) const SCHEDULES: [&str; 4] = ["trot", "crawl", "pace", "bound"];

/// Table I of Ma & Ames 2020: name, frequency Hz, clearance m, speed m/s. Its frequencies count strides: T = 1 / (2 f).
/// Last, ours: the stance's half-width over the robot's nominal one. The amble needs a wider stance to be periodic
/// (docs/planning.md, "Steps or strides").
const TABLE_I: [(&str, f64, f64, f64, f64); 5] = [
    ("gait1", 2.5, 0.11, 0.0, 1.0),
    ("gait2", 2.3, 0.12, 0.0, 1.0),
    ("gait3", 2.2, 0.15, 0.0, 1.0),
    ("gait4", 2.6, 0.13, 0.0, 1.0),
    ("amble", 2.83, 0.13, 0.35, 1.1),
];

/// More points than any plan needs: its solve would take seconds.
pub(crate) const MOST_POINTS: usize = 161;

/// Friction the plans may use; the floor should offer more.
const FRICTION: f64 = 0.6;

/// T of a frequency that counts steps.
pub fn step_duration_from_step_frequency(frequency_hz: f64) -> f64 {
    1.0 / frequency_hz
}

/// T of a frequency that counts strides, of two steps each.
pub fn step_duration_from_stride_frequency(frequency_hz: f64) -> f64 {
    1.0 / (2.0 * frequency_hz)
}

/// An invalid request.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RequestError {
    /// No behaviour of that name.
    #[error("behaviour \"{name}\" is unknown: expected one of {}", behaviours().collect::<Vec<_>>().join(", "))]
    UnknownBehaviour {
        /// What was asked for.
        name: String,
    },
    /// No contact schedule of that name.
    #[error("schedule \"{name}\" is unknown: expected one of {}", SCHEDULES.join(", "))]
    UnknownSchedule {
        /// What was asked for.
        name: String,
    },
    /// A share of a phase that a schedule does not have.
    #[error("four_leg_share is {four_leg_share}, and a {schedule} has no phase on four legs: expected 0")]
    NoFourLegPhase {
        /// The schedule's name.
        schedule: &'static str,
        /// Share of T.
        four_leg_share: f64,
    },
    /// Points that no Hermite–Simpson grid has.
    #[error("points is {value}, expected an odd number from 5 to {}", MOST_POINTS)]
    Points {
        /// What was asked for.
        value: usize,
    },
    /// A value out of its range.
    #[error("{field} is {value}, expected {lower} to {upper} {unit}")]
    OutOfRange {
        /// Which field.
        field: &'static str,
        /// Its value.
        value: f64,
        /// Smallest value accepted.
        lower: f64,
        /// Largest value accepted.
        upper: f64,
        /// Unit of all three.
        unit: &'static str,
    },
    /// A stride was expected, of two steps of their own.
    #[error(
        "the request's second step is the first one's mirror image: expected a sideways slope, a torso that leans to a \
         side, a lateral speed or a yaw rate"
    )]
    OneStep,
    /// A gait that turns, on a slope.
    #[error(
        "yaw_rate_rad_s is {yaw_rate_rad_s} and {slope} is {slope_rad}: a gait that turns repeats on level ground only, \
         expected one of them to be 0"
    )]
    TurnsOnSlope {
        /// rad/s.
        yaw_rate_rad_s: f64,
        /// Which slope.
        slope: &'static str,
        /// rad.
        slope_rad: f64,
    },
}

/// A column of the paper's Table I: what was asked there and how its solver did (FROST with IPOPT, i7-6820HQ).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TableOne {
    /// Name of the behaviour.
    pub behaviour: &'static str,
    /// Strides (two steps) a second.
    pub frequency_hz: f64,
    /// Swing clearance, m.
    pub clearance_m: f64,
    /// Forward speed, m/s: in the paper's text.
    pub speed_m_s: f64,
    /// Iterations of the paper's solver.
    pub iterations: u32,
    /// Time of the paper's nonlinear program, s.
    pub time_s: f64,
}

/// Table I of Ma & Ames 2020.
pub fn table_one() -> [TableOne; 5] {
    const PAPER: [(u32, f64); 5] = [(96, 3.54), (122, 5.34), (98, 3.72), (46, 1.75), (147, 5.45)];
    std::array::from_fn(|i| {
        let ((behaviour, frequency_hz, clearance_m, speed_m_s, _), (iterations, time_s)) = (TABLE_I[i], PAPER[i]);
        TableOne { behaviour, frequency_hz, clearance_m, speed_m_s, iterations, time_s }
    })
}

/// Names that [`GaitRequest::named`] knows.
pub fn behaviours() -> impl Iterator<Item = &'static str> {
    TABLE_I.iter().map(|row| row.0)
}

impl GaitRequest {
    /// Relative tolerance within which the solver may choose T.
    pub const STEP_DURATION_TOLERANCE: f64 = 0.01;

    /// One of the five gaits of Table I, at the robot's nominal height, stance and torque bound.
    pub fn named(name: &str, robot: &Robot) -> Result<Self, RequestError> {
        let &(behaviour, frequency_hz, clearance_m, speed_m_s, width) = TABLE_I
            .iter()
            .find(|row| row.0 == name)
            .ok_or_else(|| RequestError::UnknownBehaviour { name: name.into() })?;
        Ok(Self {
            behaviour: behaviour.into(),
            step_duration_s: step_duration_from_stride_frequency(frequency_hz),
            clearance_m,
            speed_m_s,
            lateral_speed_m_s: 0.0,
            yaw_rate_rad_s: 0.0,
            height_m: robot.nominal.height_m,
            half_width_m: width * robot.nominal.half_width_m,
            slope_rad: 0.0,
            sideways_slope_rad: 0.0,
            torso_pitch_rad: 0.0,
            torso_roll_rad: 0.0,
            friction: FRICTION,
            torque_limit_nm: robot.limits.plan_torque_nm,
        })
    }

    /// Refuses values that are not finite or outside what this planner is made for, and turning on a slope.
    /// `leg_length_m` is the longest distance from a hip axis to its toe.
    pub fn validate(&self, leg_length_m: f64) -> Result<(), RequestError> {
        for (field, value, lower, upper, unit) in self.ranges(leg_length_m) {
            // Written so that a value that is not a number is refused too.
            if !(lower..=upper).contains(&value) {
                return Err(RequestError::OutOfRange { field, value, lower, upper, unit });
            }
        }
        for (slope, slope_rad) in [("slope_rad", self.slope_rad), ("sideways_slope_rad", self.sideways_slope_rad)] {
            if self.yaw_rate_rad_s != 0.0 && slope_rad != 0.0 {
                return Err(RequestError::TurnsOnSlope { yaw_rate_rad_s: self.yaw_rate_rad_s, slope, slope_rad });
            }
        }
        Ok(())
    }

    /// Whether the second step is the mirror image of the first.
    pub fn is_mirrored(&self) -> bool {
        self.sideways_slope_rad == 0.0
            && self.torso_roll_rad == 0.0
            && self.lateral_speed_m_s == 0.0
            && self.yaw_rate_rad_s == 0.0
    }

    /// Whether the decomposed program can plan it, in which the rear legs' joints are the front ones'.
    pub fn is_decomposable(&self) -> bool {
        self.is_mirrored() && self.torso_pitch_rad == 0.0
    }

    /// Every number of the request, under one name, in a fixed order.
    pub(crate) const FIELDS: usize = 15;

    /// (field, value, smallest, largest, unit) of every number of the request.
    pub(crate) fn ranges(&self, leg_length_m: f64) -> [(&'static str, f64, f64, f64, &'static str); Self::FIELDS] {
        let [roll, pitch, knee] = self.torque_limit_nm;
        // To the millimetre, for the messages.
        let legs = |share: f64| (share * leg_length_m * 1e3).round() / 1e3;
        // Clearance: half the hip height leaves the folded leg room below the body.
        [
            ("step_duration_s", self.step_duration_s, 0.1, 2.0, "s"),
            ("height_m", self.height_m, legs(0.2), legs(0.98), "m"),
            ("half_width_m", self.half_width_m, 0.0, legs(0.8), "m"),
            ("clearance_m", self.clearance_m, 0.0, 0.5 * self.height_m, "m"),
            ("speed_m_s", self.speed_m_s, -2.0, 2.0, "m/s"),
            ("lateral_speed_m_s", self.lateral_speed_m_s, -1.0, 1.0, "m/s"),
            ("yaw_rate_rad_s", self.yaw_rate_rad_s, -2.0, 2.0, "rad/s"),
            ("slope_rad", self.slope_rad, -0.35, 0.35, "rad"),
            ("sideways_slope_rad", self.sideways_slope_rad, -0.35, 0.35, "rad"),
            ("torso_pitch_rad", self.torso_pitch_rad, -0.25, 0.25, "rad"),
            ("torso_roll_rad", self.torso_roll_rad, -0.25, 0.25, "rad"),
            ("friction", self.friction, 0.1, 1.5, ""),
            ("torque_limit_nm[hip roll]", roll, 1.0, 1000.0, "N m"),
            ("torque_limit_nm[hip pitch]", pitch, 1.0, 1000.0, "N m"),
            ("torque_limit_nm[knee]", knee, 1.0, 1000.0, "N m"),
        ]
    }

    /// The numbers of [`Self::ranges`], to be changed.
    pub(crate) fn numbers_mut(&mut self) -> [&mut f64; Self::FIELDS] {
        let [roll, pitch, knee] = &mut self.torque_limit_nm;
        [
            &mut self.step_duration_s,
            &mut self.height_m,
            &mut self.half_width_m,
            &mut self.clearance_m,
            &mut self.speed_m_s,
            &mut self.lateral_speed_m_s,
            &mut self.yaw_rate_rad_s,
            &mut self.slope_rad,
            &mut self.sideways_slope_rad,
            &mut self.torso_pitch_rad,
            &mut self.torso_roll_rad,
            &mut self.friction,
            roll,
            pitch,
            knee,
        ]
    }
}

/// Refuses points that no grid has, before the program is built on them.
pub(crate) fn check_points(points: usize) -> Result<(), RequestError> {
    if (5..=MOST_POINTS).contains(&points) && points % 2 == 1 {
        return Ok(());
    }
    Err(RequestError::Points { value: points })
}
