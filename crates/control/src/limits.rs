//! Limits, applied last: whatever the law asked for, what leaves here keeps every limit.

use crate::{Config, JOINTS, JointCommand};

/// What the limits on change need from the cycle before.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Limits {
    /// q_des of the last command; none after [`Self::let_go`].
    last_position_rad: [Option<f64>; JOINTS],
    last_torque_nm: [f64; JOINTS],
}

impl Limits {
    /// Nothing was commanded.
    pub const NOTHING: Self = Self { last_position_rad: [None; JOINTS], last_torque_nm: [0.0; JOINTS] };

    /// Forgets the last command: the next one starts anew (from damping or from nothing).
    pub fn let_go(&mut self) {
        *self = Self::NOTHING;
    }

    /// Damping at measured velocities `v`: kd, lowered where it would give more than the damping torque.
    pub fn damping(c: &Config, v: &[f64; JOINTS]) -> JointCommand {
        JointCommand::damping(std::array::from_fn(|j| damping_kd(c, j, v[j])))
    }

    /// The command that may be sent, and the torques that it gives at the measured `q` and `v`.
    ///
    /// In order: q_des within the position limits and within velocity limit × control period of the last one; q̇_des
    /// within the velocity limits; torque towards a position limit fading out in its soft stop, and torque that makes a
    /// joint faster turning into damping over the last `speed_fade_share` below its velocity limit; torque limit;
    /// growth of torque over `dt_s`. A torque is only ever made smaller by this, and never smaller than damping would
    /// make it. A command that keeps every limit leaves unaltered, to the bit.
    ///
    /// After a late cycle q_des catches up over the next ones: the step is one period's however long the cycle before
    /// was, because the drive sees it as a step.
    pub fn apply(
        &mut self,
        c: &Config,
        mut command: JointCommand,
        q: &[f64; JOINTS],
        v: &[f64; JOINTS],
        speed_fade_share: f64,
        dt_s: f64,
    ) -> (JointCommand, [f64; JOINTS]) {
        let mut torque = [0.0; JOINTS];
        for j in 0..JOINTS {
            self.limit_reference(c, &mut command, j);
            let asked = command.joint_torque(j, q[j], v[j]);
            let slowed = slowed(c, j, asked, v[j], speed_fade_share);
            let allowed = self.limit_torque(c, j, slowed, (q[j], v[j]), dt_s);
            if allowed != asked {
                let feed_forward = command.torque_nm[j] + (allowed - asked);
                if feed_forward.abs() <= c.torque_limit_nm[j] {
                    command.torque_nm[j] = feed_forward;
                } else {
                    // The law is so far off that its share alone breaks the limit: a plain torque is sent instead.
                    command.kp[j] = 0.0;
                    command.kd[j] = 0.0;
                    command.torque_nm[j] = allowed;
                }
            }
            torque[j] = allowed;
            self.last_position_rad[j] = Some(command.position_rad[j]);
            self.last_torque_nm[j] = allowed;
        }
        (command, torque)
    }

    fn limit_reference(&self, c: &Config, command: &mut JointCommand, j: usize) {
        let limit = c.velocity_limit_rad_s[j];
        let mut position = command.position_rad[j].clamp(c.position_min_rad[j], c.position_max_rad[j]);
        if let Some(last) = self.last_position_rad[j] {
            let step = limit * c.control_period_s;
            position = position.clamp(last - step, last + step);
        }
        command.position_rad[j] = position;
        command.velocity_rad_s[j] = command.velocity_rad_s[j].clamp(-limit, limit);
    }

    fn limit_torque(&self, c: &Config, j: usize, asked: f64, (q, v): (f64, f64), dt_s: f64) -> f64 {
        let mut torque = asked;
        // 1 inside, 0 at the limit and beyond.
        let room = |distance: f64| (distance / c.soft_stop_rad).clamp(0.0, 1.0);
        if torque > 0.0 {
            torque *= room(c.position_max_rad[j] - q);
        } else {
            torque *= room(q - c.position_min_rad[j]);
        }
        let limit = c.torque_limit_nm[j];
        torque = torque.clamp(-limit, limit);
        // Growth is limited from the last torque, or from zero where the sign changes; shrinking is free.
        let last = self.last_torque_nm[j];
        let growth = c.torque_rate_nm_s * dt_s;
        let bound = growth + if torque * last > 0.0 { last.abs() } else { 0.0 };
        torque = torque.clamp(-bound, bound);
        // If the limits took away more than damping would give, damping it is.
        let damping = -damping_kd(c, j, v) * v;
        if (asked - damping) * (damping - torque) > 0.0 && damping * asked > 0.0 {
            torque = damping;
        }
        torque
    }
}

/// Over the last share below its velocity limit a torque that makes the joint faster becomes damping.
fn slowed(c: &Config, j: usize, torque: f64, v: f64, fade_share: f64) -> f64 {
    let limit = c.velocity_limit_rad_s[j];
    let damping = -damping_kd(c, j, v) * v;
    if fade_share <= 0.0 || v.abs() <= (1.0 - fade_share) * limit || (torque - damping) * v <= 0.0 {
        return torque;
    }
    let room = ((limit - v.abs()) / (fade_share * limit)).clamp(0.0, 1.0);
    room * torque + (1.0 - room) * damping
}

fn damping_kd(c: &Config, j: usize, v: f64) -> f64 {
    let cap = c.damping_torque_nm.min(c.torque_limit_nm[j]);
    if v.is_finite() && c.damping_kd[j] * v.abs() > cap { cap / v.abs() } else { c.damping_kd[j] }
}
