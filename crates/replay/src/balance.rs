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
    let (sine, cosine) = yaw_rad.sin_cos();
    Some(Balanced {
        time_s,
        step: output.step_index,
        position_m: [x, y],
        yaw_rad,
        velocity: [cosine * vx + sine * vy, cosine * vy - sine * vx, estimate.angular_velocity_rad_s()[2]],
        asked: asked.map(|velocity| [velocity.forward_m_s, velocity.left_m_s, velocity.yaw_rad_s]),
        placement_m: law.placement_m,
        pace: law.pace,
    })
}
