//! What the robot walks on.

use crate::{Random, setting};
use settings::Setting;

/// Shape of the ground. Slopes turn gravity instead of the floor, so the world's x-y plane is always the ground plane
/// and a gait's initial state means the same everywhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Terrain {
    /// A level plane at z = 0.
    Flat,
    /// A plane that rises along +x by `uphill_rad` and along +y by `sideways_rad`.
    Slope {
        /// Inclination along +x, rad.
        uphill_rad: f64,
        /// Inclination along +y, rad.
        sideways_rad: f64,
    },
    /// Bumps of random height between 0 and `height_m` on a square grid, 24 m by 24 m about the origin.
    Rough {
        /// Highest bump, m.
        height_m: f64,
        /// Side of a grid cell, m.
        cell_m: f64,
    },
    /// A flight of ten stairs upwards along +x that begins 1 m in front of the origin.
    Steps {
        /// Rise of a stair, m.
        rise_m: f64,
        /// Depth of a stair, m.
        run_m: f64,
    },
    /// Stairs without end upwards along +x, in the axes of their slope as on [`Terrain::Slope`]: the middles of the
    /// treads lie at z = 0, one of them at x = `middle_m`.
    Staircase {
        /// Rise of a stair, m.
        rise_m: f64,
        /// Depth of a tread, m.
        run_m: f64,
        /// Where the middle of a tread is, m.
        middle_m: f64,
    },
    /// Level ground, from 1 m in front of the origin on a plane that rises (or, negative, falls) along +x.
    Ramp {
        /// Inclination, rad.
        incline_rad: f64,
    },
    /// A kerb up 1 m in front of the origin and down again 2 m after it, across the whole way.
    Kerb {
        /// Its height, m.
        height_m: f64,
    },
    /// Rolling ground, 3 m from hill to hill, with bumps on it, 24 m by 24 m about the origin.
    Hills {
        /// Steepest inclination, rad.
        incline_rad: f64,
        /// Highest bump, m.
        bump_m: f64,
    },
}

/// Half the side of the rough field, m.
const ROUGH_HALF_SIDE_M: f64 = 12.0;
/// Where the first stair begins, m.
const STAIRS_START_M: f64 = 1.0;
const STAIRS: usize = 10;
/// Of a staircase without end: more than any walk climbs.
const STAIRS_BEHIND: i32 = 10;
const STAIRS_AHEAD: i32 = 60;
/// Half the width of the stairs, m.
const STAIRS_HALF_WIDTH_M: f64 = 3.0;
/// How far the landing above the last stair reaches, m.
const LANDING_M: f64 = 20.0;
/// Where ramps and kerbs begin, and how long a kerb is, m.
const OBSTACLE_START_M: f64 = 1.0;
const KERB_M: f64 = 2.0;
/// From hill to hill, m, and the side of a bump on them.
const HILL_M: f64 = 3.0;
const BUMP_CELL_M: f64 = 0.2;

/// Boxes whose tops are the treads, turned back from the axes of their slope, with a plane far below them.
fn staircase(rise_m: f64, run_m: f64, middle_m: f64) -> String {
    let incline_rad = rise_m.atan2(run_m);
    let (sine, cosine) = incline_rad.sin_cos();
    let (half_sine, half_cosine) = (0.5 * incline_rad).sin_cos();
    let stride_m = rise_m.hypot(run_m);
    let first_m = middle_m - stride_m * (middle_m / stride_m).floor();
    let mut boxes = r#"<geom name="floor" type="plane" size="0 0 0.5" pos="0 0 -2" material="floor"/>"#.to_owned();
    for stair in -STAIRS_BEHIND..STAIRS_AHEAD {
        // From the middle of the tread against up to the middle of the box, which is as high as two stairs.
        let (x, z) = (first_m + stride_m * f64::from(stair) - rise_m * sine, -rise_m * cosine);
        boxes += &format!(
            r#"<geom type="box" size="{} {STAIRS_HALF_WIDTH_M} {rise_m}" pos="{x} 0 {z}" quat="{half_cosine} 0 {half_sine} 0" material="stair{}"/>"#,
            0.5 * run_m,
            stair.rem_euclid(2)
        );
    }
    boxes
}

impl Terrain {
    /// The first thing wrong with the terrain's numbers, for the user.
    pub fn problem(&self) -> Option<String> {
        let wrong = |setting: Setting, value: f64| {
            setting.check(value).err().map(|wrong| format!("terrain {} {wrong}", setting.name))
        };
        let outside = |name: &str, value: f64, low: f64, high: f64, unit: &str| {
            (!(low..=high).contains(&value))
                .then(|| format!("terrain {name} is {value} {unit}, expected {low} to {high} {unit}"))
        };
        match *self {
            Self::Flat => None,
            Self::Slope { uphill_rad, sideways_rad } => wrong(setting::SLOPE_UPHILL_DEG, uphill_rad.to_degrees())
                .or_else(|| wrong(setting::SLOPE_SIDEWAYS_DEG, sideways_rad.to_degrees())),
            Self::Rough { height_m, cell_m } => {
                wrong(setting::BUMP_HEIGHT_M, height_m).or_else(|| wrong(setting::BUMP_CELL_M, cell_m))
            }
            Self::Steps { rise_m, run_m } => {
                wrong(setting::STAIR_RISE_M, rise_m).or_else(|| wrong(setting::STAIR_RUN_M, run_m))
            }
            Self::Staircase { rise_m, run_m, middle_m } => wrong(setting::STAIR_RISE_M, rise_m)
                .or_else(|| wrong(setting::STAIR_RUN_M, run_m))
                .or_else(|| outside("middle of a tread", middle_m, -10.0, 10.0, "m")),
            Self::Ramp { incline_rad } => outside("ramp", incline_rad.to_degrees(), -30.0, 30.0, "degrees"),
            Self::Kerb { height_m } => outside("kerb height", height_m, 0.005, 0.3, "m"),
            Self::Hills { incline_rad, bump_m } => outside("hills", incline_rad.to_degrees(), 0.0, 30.0, "degrees")
                .or_else(|| outside("bump height", bump_m, 0.0, 0.3, "m")),
        }
    }

    /// Gravity in world axes, m/s².
    pub(crate) fn gravity_m_s2(&self) -> [f64; 3] {
        let (pitch, roll) = match *self {
            Self::Slope { uphill_rad, sideways_rad } => (uphill_rad, sideways_rad),
            Self::Staircase { rise_m, run_m, .. } => (rise_m.atan2(run_m), 0.0),
            _ => (0.0, 0.0),
        };
        [-pitch.sin() * roll.cos(), -roll.sin(), -pitch.cos() * roll.cos()].map(|g| g * crate::GRAVITY_M_S2)
    }

    /// How far above the nominal floor a robot is put down whose toes are there in the world, so that none starts
    /// inside the ground, m: the field of heights would hold it fast for seconds.
    pub(crate) fn lift_m(&self, toes_m: &[[f64; 3]]) -> f64 {
        match *self {
            Self::Rough { height_m, .. } => height_m,
            Self::Ramp { .. } => self.ground_m(0.0, 0.0),
            Self::Hills { bump_m, .. } => {
                bump_m + toes_m.iter().map(|&[x, y, _]| self.ground_m(x, y)).fold(0.0, f64::max)
            }
            _ => 0.0,
        }
    }

    /// Height that counts as "the ground" for judging a fall of a body at `x`, `y`, m.
    pub(crate) fn ground_m(&self, x: f64, y: f64) -> f64 {
        match *self {
            Self::Rough { height_m, .. } => height_m,
            Self::Steps { rise_m, run_m } => rise_m * ((x - STAIRS_START_M) / run_m).ceil().clamp(0.0, STAIRS as f64),
            Self::Ramp { incline_rad } => {
                // Down a ramp the level ground lies as high as the ramp is long.
                let top = (-incline_rad.tan()).max(0.0) * (ROUGH_HALF_SIDE_M - OBSTACLE_START_M);
                top + incline_rad.tan() * (x.min(ROUGH_HALF_SIDE_M) - OBSTACLE_START_M).max(0.0)
            }
            Self::Kerb { height_m } if (OBSTACLE_START_M..OBSTACLE_START_M + KERB_M).contains(&x) => height_m,
            Self::Hills { incline_rad, .. } => {
                let k = std::f64::consts::TAU / HILL_M;
                incline_rad.tan() / k * (1.0 + (k * x).sin() * (k * y).cos())
            }
            _ => 0.0,
        }
    }

    /// Whether the ground is a field of heights.
    fn is_field(&self) -> bool {
        matches!(self, Self::Rough { .. } | Self::Ramp { .. } | Self::Hills { .. })
    }

    /// Height of the field's highest possible sample, m.
    fn field_top_m(&self) -> f64 {
        match *self {
            Self::Rough { height_m, .. } => height_m,
            Self::Ramp { incline_rad } => (incline_rad.abs().tan() * (ROUGH_HALF_SIDE_M - OBSTACLE_START_M)).max(1e-3),
            Self::Hills { incline_rad, bump_m } => {
                (incline_rad.tan() * HILL_M / std::f64::consts::PI + bump_m).max(1e-3)
            }
            _ => 0.0,
        }
    }

    /// Samples along a side of the field.
    fn samples(&self) -> usize {
        match *self {
            Self::Rough { cell_m, .. } => Self::grid(cell_m).0,
            // Two samples a bump.
            _ => Self::grid(BUMP_CELL_M).0 + 1,
        }
    }

    /// Rows and columns of the rough field's grid and the side of its square, m.
    fn grid(cell_m: f64) -> (usize, usize) {
        // A cell is drawn with two samples a side at least, or MuJoCo's triangles would turn the blocks into a smooth
        // hill.
        let samples_per_cell = 2;
        let cells = (2.0 * ROUGH_HALF_SIDE_M / cell_m).round().max(1.0) as usize;
        (cells * samples_per_cell, samples_per_cell)
    }

    /// MJCF for `<asset>` and for `<worldbody>`.
    pub(crate) fn mjcf(&self) -> (String, String) {
        let plane =
            |z: f64| format!(r#"<geom name="floor" type="plane" size="0 0 0.5" pos="0 0 {z}" material="floor"/>"#);
        match *self {
            Self::Flat | Self::Slope { .. } => (String::new(), plane(0.0)),
            Self::Rough { .. } | Self::Ramp { .. } | Self::Hills { .. } => {
                let (n, top_m) = (self.samples(), self.field_top_m());
                (
                    format!(
                        r#"<hfield name="rough" nrow="{n}" ncol="{n}" size="{ROUGH_HALF_SIDE_M} {ROUGH_HALF_SIDE_M} {top_m} 0.1"/>"#
                    ),
                    // The plane lies just under the field, for a robot that walks off it.
                    format!(r#"{}<geom name="rough" type="hfield" hfield="rough" material="floor"/>"#, plane(-0.002)),
                )
            }
            Self::Kerb { height_m } => {
                let (half, middle) = (0.5 * height_m, OBSTACLE_START_M + 0.5 * KERB_M);
                let kerb = format!(
                    r#"<geom type="box" size="{} {ROUGH_HALF_SIDE_M} {half}" pos="{middle} 0 {half}" material="stair0"/>"#,
                    0.5 * KERB_M
                );
                (String::new(), plane(0.0) + &kerb)
            }
            Self::Staircase { rise_m, run_m, middle_m } => (String::new(), staircase(rise_m, run_m, middle_m)),
            Self::Steps { rise_m, run_m } => {
                let mut boxes = plane(0.0);
                for stair in 0..STAIRS {
                    let front = STAIRS_START_M + run_m * stair as f64;
                    let back = STAIRS_START_M + run_m * STAIRS as f64 + LANDING_M;
                    let half_height = 0.5 * rise_m;
                    boxes += &format!(
                        r#"<geom type="box" size="{} {STAIRS_HALF_WIDTH_M} {half_height}" pos="{} 0 {}" material="stair{}"/>"#,
                        0.5 * (back - front),
                        0.5 * (back + front),
                        rise_m * stair as f64 + half_height,
                        stair % 2
                    );
                }
                (String::new(), boxes)
            }
        }
    }

    /// Heights of the field's samples as fractions of its height, row by row (y, then x); empty for other terrains.
    pub(crate) fn heights(&self, seed: u64) -> Vec<f32> {
        if !self.is_field() {
            return Vec::new();
        }
        let n = self.samples();
        let (top_m, mut random) = (self.field_top_m(), Random::new(seed));
        if let Self::Rough { cell_m, .. } = *self {
            let (_, per_cell) = Self::grid(cell_m);
            let cells = n / per_cell;
            let heights: Vec<f32> = (0..cells * cells).map(|_| random.uniform() as f32).collect();
            return (0..n * n).map(|i| heights[(i / n / per_cell) * cells + (i % n) / per_cell]).collect();
        }
        let bump_m = if let Self::Hills { bump_m, .. } = *self { bump_m } else { 0.0 };
        let at = |i: usize| ROUGH_HALF_SIDE_M * (2.0 * i as f64 / (n - 1) as f64 - 1.0);
        let height = |i: usize| (self.ground_m(at(i % n), at(i / n)) + bump_m * random.uniform()) / top_m;
        (0..n * n).map(height).map(|height| height as f32).collect()
    }
}
