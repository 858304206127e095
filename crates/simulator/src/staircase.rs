//! The staircase that a gait is planned for: the middles of its treads lie where the gait's toes stand.

use crate::{Simulator, SimulatorError, SimulatorOptions, Terrain};
use gait::Gait;
use robot::Robot;

/// How far from the middle of its tread a toe may be planned, m.
const MOST_AWAY_M: f64 = 0.02;

/// Why a gait has no staircase.
#[derive(Debug, thiserror::Error)]
pub enum StaircaseError {
    /// Its toes do not land a whole number of strides apart.
    #[error(
        "\"{gait}\" is not planned for stairs: expected a gait of `tandem plan --schedule crawl --stairs RISE RUN`"
    )]
    NotPlanned {
        /// The gait's name.
        gait: String,
    },
    /// A toe stands beside its tread's middle.
    #[error("\"{gait}\" has a toe {away_m:.3} m from the middle of its tread, expected at most {MOST_AWAY_M} m")]
    BesideTreads {
        /// The gait's name.
        gait: String,
        /// How far the farthest toe is, m.
        away_m: f64,
    },
    /// The robot's model.
    #[error(transparent)]
    Simulator(#[from] SimulatorError),
}

impl Terrain {
    /// The stairs that a gait is planned for (`gait_design::ScheduleOptions::treads`): each leg climbs one a stride.
    ///
    /// # Errors
    ///
    /// If the gait is planned for none, or its toes do not stand in the middles of treads.
    pub fn staircase_of(robot: &Robot, gait: &Gait) -> Result<Self, StaircaseError> {
        let slope_rad = gait.request["slope_rad"].as_f64();
        let (Some(slope_rad), Some(true)) = (slope_rad, gait.request["treads"].as_bool()) else {
            return Err(StaircaseError::NotPlanned { gait: gait.name.clone() });
        };
        let mut simulator = Simulator::new(robot, SimulatorOptions::default())?;
        simulator.reset_to_gait(gait)?;
        let toes_m = simulator.toe_positions_m();
        let (stride_m, middle_m) = (gait.speed_m_s() * gait.stride_duration_s(), toes_m[0][0]);
        let away_m = toes_m.iter().fold(0.0, |most: f64, toe| {
            let strides = (toe[0] - middle_m) / stride_m;
            most.max((strides - strides.round()).abs() * stride_m)
        });
        if away_m > MOST_AWAY_M {
            return Err(StaircaseError::BesideTreads { gait: gait.name.clone(), away_m });
        }
        Ok(Self::Staircase { rise_m: stride_m * slope_rad.sin(), run_m: stride_m * slope_rad.cos(), middle_m })
    }
}
