//! A base that lies on its side or its back, for the answer to who asks it to stand up.

use crate::InertialState;

/// A base that is tilted further than allowed: roll and pitch in whole degrees.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tilted {
    /// Rotation about the forward axis, degrees.
    pub roll_deg: i16,
    /// Rotation about the leftward axis, degrees.
    pub pitch_deg: i16,
}

impl Tilted {
    /// By the inertial unit; none where it reports no tilt beyond the limit, or none at all.
    pub(crate) fn beyond(limit_rad: f64, inertial: Option<&InertialState>) -> Option<Self> {
        let tilt = inertial?.tilt()?;
        let degrees = |angle: f64| angle.to_degrees().round() as i16;
        let far = tilt.roll_rad.abs().max(tilt.pitch_rad.abs()) > limit_rad;
        far.then(|| Self { roll_deg: degrees(tilt.roll_rad), pitch_deg: degrees(tilt.pitch_rad) })
    }

    /// Which side is down.
    fn onto(&self) -> &'static str {
        let [(sr, cr), (sp, cp)] = [self.roll_deg, self.pitch_deg].map(|angle| f64::from(angle).to_radians().sin_cos());
        // The upward direction along the base's axes: forward, left, up.
        let [forward, left, up] = [-sp, sr * cp, cr * cp];
        if -up > forward.abs().max(left.abs()) {
            "its back"
        } else if left.abs() >= forward.abs() {
            if left > 0.0 { "its right side" } else { "its left side" }
        } else if forward > 0.0 {
            "its rear"
        } else {
            "its front"
        }
    }
}

impl std::fmt::Display for Tilted {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "tilted onto {} (roll {}°, pitch {}°)", self.onto(), self.roll_deg, self.pitch_deg)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Tilt;
    use std::time::Duration;

    #[test]
    fn it_says_which_side_is_down() {
        let at = |roll: f64, pitch: f64| {
            let tilt = Tilt { roll_rad: roll.to_radians(), pitch_rad: pitch.to_radians() };
            Tilted::beyond(0.8, Some(&InertialState::tilted(tilt, Duration::ZERO))).map(|tilted| tilted.to_string())
        };
        assert_eq!(at(40.0, -40.0), None);
        assert_eq!(at(90.0, 1.0).unwrap(), "tilted onto its right side (roll 90°, pitch 1°)");
        assert_eq!(at(-50.0, 0.0).unwrap(), "tilted onto its left side (roll -50°, pitch 0°)");
        assert_eq!(at(175.0, 10.0).unwrap(), "tilted onto its back (roll 175°, pitch 10°)");
        // The nose points down where the pitch is positive (REP 103).
        assert_eq!(at(0.0, 80.0).unwrap(), "tilted onto its front (roll 0°, pitch 80°)");
        assert_eq!(at(0.0, -80.0).unwrap(), "tilted onto its rear (roll 0°, pitch -80°)");
        // Nothing is said of a tilt that was not measured, or that is none.
        assert_eq!(Tilted::beyond(0.8, None), None);
        let no_rotation = InertialState {
            attitude_xyzw: Some([0.0; 4]),
            ..InertialState::tilted(Tilt { roll_rad: 0.0, pitch_rad: 0.0 }, Duration::ZERO)
        };
        assert_eq!(Tilted::beyond(0.8, Some(&no_rotation)), None);
    }
}
