//! The law: from where in a step the gait is to what the drives are asked for, before limits.

pub mod balanced;

use crate::gait_clock::{Growth, Place};
use crate::prepared_gait::Instant;
use crate::{JOINTS, JointCommand, PreparedGait};
use balanced::Balanced;

/// A change of gait is smoothed out over this share of its first step.
const CHANGE_SHARE: f64 = 0.5;

/// The laws that there are, each with what it remembers. Closed, so that a snapshot stays `Copy` and a recording runs
/// again.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
// The cycle must not allocate, so the large variant is not boxed.
#[allow(clippy::large_enum_variant)]
pub(crate) enum Law {
    /// The paper's: the gait's clock and its plan, nothing measured.
    #[default]
    Paper,
    /// The same law on a reference that follows what is measured.
    Balanced(Balanced),
}

impl Law {
    /// How fast the phase runs, in units of 1 / T.
    pub fn phase_rate(&self) -> f64 {
        match self {
            Self::Paper => 1.0,
            Self::Balanced(balanced) => balanced.pace(),
        }
    }

    /// What is asked for at this place of the gait. The same place gives the same answer, however often it is asked.
    pub fn reference(&self, gait: &PreparedGait, place: &Place) -> JointCommand {
        match self {
            Self::Paper => paper(gait, place),
            Self::Balanced(balanced) => balanced.reference(),
        }
    }

    /// Positions and velocities at the switch `place`, from which a walk that ends there comes to rest.
    pub fn at_switch(&self, gait: &PreparedGait, place: &Place) -> ([f64; JOINTS], [f64; JOINTS]) {
        match self {
            Self::Paper => {
                let at = grown(gait, gait.at_step(place.step, 0.0), place.growth);
                let left = |at: [f64; JOINTS], offset: Option<[f64; JOINTS]>| {
                    offset.map_or(at, |offset| std::array::from_fn(|j| at[j] + offset[j]))
                };
                let offset = place.offset;
                (
                    left(at.position_rad, offset.map(|offset| offset.position_rad)),
                    left(at.velocity_rad_s, offset.map(|offset| offset.velocity_rad_s)),
                )
            }
            Self::Balanced(balanced) => balanced.at_switch(),
        }
    }
}

/// The plan, grown to the share that is walked, with what a change of gait left.
fn paper(gait: &PreparedGait, place: &Place) -> JointCommand {
    let at = grown(gait, gait.at_step(place.step, place.phase), place.growth);
    let mut reference = JointCommand {
        position_rad: at.position_rad,
        velocity_rad_s: at.velocity_rad_s,
        kp: gait.kp(place.step),
        kd: gait.kd(place.step),
        torque_nm: at.torque_nm,
    };
    smooth_change(&mut reference, place);
    reference
}

/// Lets the jump that a change of gait made, or a switch of a lead, run out.
pub(crate) fn smooth_change(reference: &mut JointCommand, place: &Place) {
    let duration_s = CHANGE_SHARE * place.period_s;
    let Some(offset) = place.offset.filter(|_| place.t_s < duration_s) else { return };
    let x = place.t_s / duration_s;
    let (h00, h10) = ((1.0 + 2.0 * x) * (1.0 - x) * (1.0 - x), x * (1.0 - x) * (1.0 - x));
    let (d00, d10) = (6.0 * x * (x - 1.0) / duration_s, (1.0 - x) * (1.0 - 3.0 * x));
    for j in 0..JOINTS {
        let (dq, dv) = (offset.position_rad[j], offset.velocity_rad_s[j]);
        reference.position_rad[j] += h00 * dq + h10 * duration_s * dv;
        reference.velocity_rad_s[j] += d00 * dq + d10 * dv;
    }
}

/// A share of a gait's motion about the middle of its switches. To first order the base moves over two legs like an
/// inverted pendulum, whose motions about a posture of balance are motions at any size.
pub(crate) fn grown(gait: &PreparedGait, at: Instant, growth: Growth) -> Instant {
    // To the bit the gait itself.
    if growth.is_whole() {
        return at;
    }
    let middle = gait.middle_rad(false);
    let Growth { share, rate } = growth;
    Instant {
        position_rad: std::array::from_fn(|j| middle[j] + share * (at.position_rad[j] - middle[j])),
        velocity_rad_s: std::array::from_fn(|j| share * at.velocity_rad_s[j] + rate * (at.position_rad[j] - middle[j])),
        torque_nm: at.torque_nm,
    }
}
