//! What the balanced law saw and did. It is not recorded: it is computed again from what is.

use std::path::Path;

use control::Mode;
use report::Balanced;

use crate::ReplayError;
use crate::verify::{Followed, follow};

/// One sample in so many cycles.
const EVERY: u64 = 10;

/// The balanced walks in a bag, a hundred samples a second, each with the greatest pace until the next; none where the
/// paper's law walked.
///
/// # Errors
/// As [`crate::verify()`]: what is not recorded whole cannot be computed again.
pub fn read_balance(path: impl AsRef<Path>) -> Result<Vec<Balanced>, ReplayError> {
    let mut found: Vec<Balanced> = Vec::new();
    follow(path.as_ref(), &mut |time_s, followed| {
        if let Some(now) = sample(time_s, followed) {
            match found.last_mut() {
                Some(last) if last.step == now.step && !followed.output.cycles.is_multiple_of(EVERY) => {
                    last.pace = last.pace.max(now.pace);
                }
                _ => found.push(now),
            }
        }
    })?;
    Ok(found)
}

fn sample(time_s: f64, Followed { output, asked }: &Followed) -> Option<Balanced> {
    if !matches!(output.mode, Mode::Walking | Mode::Stopping) {
        return None;
    }
    let (estimate, law) = (output.estimate?, output.balance?);
    let ([x, y, _], [vx, vy, _], yaw_rad) = (estimate.position_m(), estimate.velocity_m_s(), estimate.yaw_rad());
    let [ahead, left] = in_heading([vx, vy], yaw_rad);
    Some(Balanced {
        time_s,
        step: output.step_index,
        position_m: [x, y],
        yaw_rad,
        velocity: [ahead, left, estimate.angular_velocity_rad_s()[2]],
        asked: asked.map(|velocity| [velocity.forward_m_s, velocity.left_m_s, velocity.yaw_rad_s]),
        placement_m: law.placement_m,
        pace: law.pace,
    })
}

/// A vector of the world's, ahead and to the left of who looks in the direction `yaw_rad`.
fn in_heading([x, y]: [f64; 2], yaw_rad: f64) -> [f64; 2] {
    let (sine, cosine) = yaw_rad.sin_cos();
    [cosine * x + sine * y, cosine * y - sine * x]
}

#[cfg(test)]
mod tests {
    use super::in_heading;
    use std::f64::consts::FRAC_PI_2;

    /// A wrong sign of the turn shows only where the robot does not look along x.
    #[test]
    fn who_looks_to_the_left_and_goes_there_goes_ahead() {
        for (velocity, expected) in [([0.0, 0.3], [0.3, 0.0]), ([-0.2, 0.0], [0.0, 0.2])] {
            let found = in_heading(velocity, FRAC_PI_2);
            assert!((0..2).all(|axis| (found[axis] - expected[axis]).abs() < 1e-12), "{velocity:?}: {found:?}");
        }
    }
}
