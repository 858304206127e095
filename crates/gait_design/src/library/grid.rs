//! The grid of requests.

use super::error::LibraryError;
use crate::leg_length_m;
use crate::request::GaitRequest;
use robot::Robot;
use serde::{Deserialize, Serialize};

/// Most points of a grid.
pub const MOST_POINTS: usize = 1_000_000;

/// A number of a request that a grid can vary.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Field {
    /// T, s.
    StepDurationS,
    /// Swing clearance, m.
    ClearanceM,
    /// Forward speed, m/s.
    SpeedMS,
    /// Hip axes above the toe centres, m.
    HeightM,
    /// Lateral distance of a stance toe from the mid plane, m.
    HalfWidthM,
    /// Slope along the walk, rad.
    SlopeRad,
    /// Speed to the left, m/s.
    LateralSpeedMS,
    /// Yaw rate, rad/s.
    YawRateRadS,
}

impl Field {
    /// All of them, by their names in a request.
    pub const ALL: [(&'static str, Self); 8] = [
        ("step_duration_s", Self::StepDurationS),
        ("clearance_m", Self::ClearanceM),
        ("speed_m_s", Self::SpeedMS),
        ("height_m", Self::HeightM),
        ("half_width_m", Self::HalfWidthM),
        ("slope_rad", Self::SlopeRad),
        ("lateral_speed_m_s", Self::LateralSpeedMS),
        ("yaw_rate_rad_s", Self::YawRateRadS),
    ];

    /// Its name in a request.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, field)| *field == self).expect("all fields are listed").0
    }

    /// Changes it in a request.
    pub fn set(self, request: &mut GaitRequest, value: f64) {
        *self.of(request) = value;
    }

    pub(super) fn of(self, request: &mut GaitRequest) -> &mut f64 {
        match self {
            Self::StepDurationS => &mut request.step_duration_s,
            Self::ClearanceM => &mut request.clearance_m,
            Self::SpeedMS => &mut request.speed_m_s,
            Self::HeightM => &mut request.height_m,
            Self::HalfWidthM => &mut request.half_width_m,
            Self::SlopeRad => &mut request.slope_rad,
            Self::LateralSpeedMS => &mut request.lateral_speed_m_s,
            Self::YawRateRadS => &mut request.yaw_rate_rad_s,
        }
    }
}

/// One axis of a grid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Axis {
    /// What it varies.
    pub field: Field,
    /// Its values, ascending.
    pub values: Vec<f64>,
}

impl Axis {
    /// The place of the value that is this place's but for its sign, if there is one.
    fn opposite(&self, place: usize) -> Option<usize> {
        let span = self.values[self.values.len() - 1] - self.values[0];
        // Values that were spread between two ends are rounded.
        self.values.iter().position(|value| (value + self.values[place]).abs() <= 1e-12 * span)
    }
}

/// Requests that differ from a base in the axes' fields: every combination of the axes' values. The last axis varies
/// fastest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grid {
    pub(super) base: GaitRequest,
    pub(super) axes: Vec<Axis>,
}

impl Grid {
    /// Checks that the axes are ascending, different and not too many points, and that the grid's two ends are requests
    /// that are valid.
    pub fn new(robot: &Robot, base: GaitRequest, axes: Vec<Axis>) -> Result<Self, LibraryError> {
        let grid = Self { base, axes };
        grid.check()?;
        for pick in [0, 1] {
            let mut request = grid.base.clone();
            for axis in &grid.axes {
                *axis.field.of(&mut request) = axis.values[pick * (axis.values.len() - 1)];
            }
            request.validate(leg_length_m(robot))?;
        }
        Ok(grid)
    }

    pub(super) fn check(&self) -> Result<(), LibraryError> {
        let wrong = |problem: String| Err(LibraryError::Grid(problem));
        if self.axes.is_empty() {
            return wrong("has no axis: give at least one".into());
        }
        let mut points = 1_usize;
        for (index, axis) in self.axes.iter().enumerate() {
            let name = axis.field.name();
            if self.axes[..index].iter().any(|other| other.field == axis.field) {
                return wrong(format!("has two axes {name}: give each once"));
            }
            if axis.values.is_empty() || axis.values.iter().any(|v| !v.is_finite()) {
                return wrong(format!("axis {name} has no values or one that is not finite"));
            }
            if axis.values.windows(2).any(|w| w[0] >= w[1]) {
                return wrong(format!("axis {name} is not ascending: {:?}", axis.values));
            }
            points = points.saturating_mul(axis.values.len());
        }
        if points > MOST_POINTS {
            return wrong(format!("has {points} points, expected at most {MOST_POINTS}"));
        }
        Ok(())
    }

    /// Number of points.
    pub fn points(&self) -> usize {
        self.axes.iter().map(|axis| axis.values.len()).product()
    }

    /// Points of a row: those that differ in the last axis only. Point `index` belongs to row `index / row_length`.
    pub fn row_length(&self) -> usize {
        self.axes.last().map_or(1, |axis| axis.values.len())
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.points() / self.row_length()
    }

    /// The axes.
    pub fn axes(&self) -> &[Axis] {
        &self.axes
    }

    /// The request of a point.
    pub fn request(&self, index: usize) -> GaitRequest {
        let mut request = self.base.clone();
        for (axis, place) in self.axes.iter().zip(self.places(index)) {
            *axis.field.of(&mut request) = axis.values[place];
        }
        request
    }

    /// Whether all its gaits are planned as strides, both steps of each: one of them has a second step that is no
    /// mirror image of its first, or a torso that leans.
    pub(super) fn is_of_strides(&self) -> bool {
        let aside = |axis: &Axis| matches!(axis.field, Field::LateralSpeedMS | Field::YawRateRadS);
        !self.base.is_decomposable() || self.axes.iter().any(aside)
    }

    /// The point whose gait's mirror image is this point's gait: that which goes to the left or turns to the left where
    /// this one does so to the right.
    pub fn mirror_of(&self, index: usize) -> Option<usize> {
        let level = self.base.sideways_slope_rad == 0.0 && self.base.torso_roll_rad == 0.0;
        let request = self.request(index);
        let (lateral, yaw) = (request.lateral_speed_m_s, request.yaw_rate_rad_s);
        let to_the_right = lateral < 0.0 || (lateral == 0.0 && yaw < 0.0);
        if !(level && to_the_right) {
            return None;
        }
        let mut mirrored = 0;
        for (axis, place) in self.axes.iter().zip(self.places(index)) {
            let place = match axis.field {
                Field::LateralSpeedMS | Field::YawRateRadS => axis.opposite(place)?,
                _ => place,
            };
            mirrored = mirrored * axis.values.len() + place;
        }
        // A value that no axis varies has no opposite in the grid.
        let has = |field| self.axes.iter().any(|axis| axis.field == field);
        let whole = (has(Field::LateralSpeedMS) || lateral == 0.0) && (has(Field::YawRateRadS) || yaw == 0.0);
        (whole && mirrored != index).then_some(mirrored)
    }

    /// A point's place on every axis.
    fn places(&self, mut index: usize) -> Vec<usize> {
        let mut places: Vec<usize> = Vec::new();
        for axis in self.axes.iter().rev() {
            places.push(index % axis.values.len());
            index /= axis.values.len();
        }
        places.reverse();
        places
    }

    /// A point's values on the axes, for people.
    pub fn describe(&self, index: usize) -> String {
        let mut request = self.request(index);
        let parts: Vec<String> =
            self.axes.iter().map(|a| format!("{} {}", a.field.name(), a.field.of(&mut request))).collect();
        parts.join(", ")
    }
}
