//! A state of the robot: where a transition begins, and what it is to reach.

use crate::Tolerances;
use crate::request::GaitRequest;
use crate::terms::Names;
use gait::{Gait, LEGS};
use nalgebra::{Matrix2, Matrix3, Quaternion, UnitQuaternion, Vector2, Vector3};
use rigid_body::{Data, PointKinematics, point_kinematics};
use robot::Robot;

/// q and q̇ as in [`crate::PlanPoint`]: (x, y, z, roll, pitch, yaw, 12 joints), m and rad, z of the base measured from
/// the toe centres' plane; velocities are their plain derivatives. On a slope the plane is the slope's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// q.
    pub q: [f64; 18],
    /// q̇.
    pub v: [f64; 18],
}

/// A state that no step of the trot begins at.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StateError {
    /// A number that is none.
    #[error("the state has a number that is not finite: {what} is {value}")]
    NotFinite {
        /// Which.
        what: String,
        /// Its value.
        value: f64,
    },
    /// A toe that is to stand is not on the floor.
    #[error(
        "{toe} is {height_m:.4} m above the floor, expected at most {allowed_m:.4} m either way where it is to stand: \
         a step begins with the rear left and the front right toe on the floor"
    )]
    NotOnTheFloor {
        /// Which.
        toe: String,
        /// Of its centre above the toe centres' plane.
        height_m: f64,
        /// At most so much, either way.
        allowed_m: f64,
    },
    /// A toe that is to stand moves.
    #[error(
        "{toe} moves at {speed_m_s:.3} m/s, expected at most {allowed_m_s:.3} m/s where it is to stand: give joint rates \
         with which it rests (State::with_stance_at_rest)"
    )]
    Moves {
        /// Which.
        toe: String,
        /// Its speed.
        speed_m_s: f64,
        /// At most so much.
        allowed_m_s: f64,
    },
    /// A leg whose joints cannot bring its toe to rest.
    #[error(
        "no rates of its joints within their limits bring {toe} to rest: the body is too fast or its leg too straight"
    )]
    TooFast {
        /// Which.
        toe: String,
    },
}

/// Legs that stand where a transition begins.
const STANCE: [usize; 2] = [1, 2];
/// Fastest that a toe may move that is to stand, m/s: 2 mm over a step of 0.2 s.
const REST_M_S: f64 = 0.01;

impl State {
    /// The robot as it stands before it walks: joints of its standing posture, the body level, at rest.
    pub fn standing(robot: &Robot) -> Self {
        let mut state = Self { q: [0.0; 18], v: [0.0; 18] };
        state.q[6..].copy_from_slice(&robot.stand_rad());
        let toes = state.toes_m(robot);
        state.q[2] = -toes.iter().map(|toe| toe.z).sum::<f64>() / LEGS as f64;
        state
    }

    /// Where a gait's first step begins.
    pub fn start_of(robot: &Robot, gait: &Gait) -> Self {
        let i = &gait.initial;
        let [x, y, z, w] = i.base_quaternion_xyzw;
        let (roll, pitch, yaw) = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).euler_angles();
        let [px, py, pz] = i.base_position_m;
        let mut state = Self { q: [0.0; 18], v: [0.0; 18] };
        // The plan's floor is the toe centres' plane, one toe radius above the real one.
        state.q[..6].copy_from_slice(&[px, py, pz - robot.toe_radius_m, roll, pitch, yaw]);
        state.q[6..].copy_from_slice(&i.joint_position_rad);
        state.v[..3].copy_from_slice(&i.base_linear_velocity_world);
        state.v[3..6].copy_from_slice(&angle_rates(roll, pitch, i.base_angular_velocity_body));
        state.v[6..].copy_from_slice(&i.joint_velocity_rad_s);
        state
    }

    /// The same with those rates of the joints of legs 1 and 2, with which a step begins, at which their toes rest.
    ///
    /// # Errors
    ///
    /// If a joint would have to be faster than it can.
    pub fn with_stance_at_rest(mut self, robot: &Robot) -> Result<Self, StateError> {
        let mut data = Data::new(&robot.model);
        for leg in STANCE {
            let first = 6 + 3 * leg;
            let toe = self.toe(robot, &mut data, leg);
            let jacobian = toe.jacobian.fixed_columns::<3>(first).into_owned();
            let inverse = jacobian.try_inverse().unwrap_or_else(|| Matrix3::repeat(f64::INFINITY));
            let change = inverse * toe.velocity;
            for k in 0..3 {
                self.v[first + k] -= change[k];
                // Written so that a rate that is not a number is refused too.
                let limit = robot.limits.velocity_rad_s[k];
                if !(-limit..=limit).contains(&self.v[first + k]) {
                    return Err(StateError::TooFast { toe: Names::of(robot).toe(leg) });
                }
            }
        }
        Ok(self)
    }

    fn toe<'a>(&self, robot: &Robot, data: &'a mut Data, leg: usize) -> &'a PointKinematics {
        point_kinematics(&robot.model, data, &self.q, &self.v, &[0.0; 18], robot.legs[leg].toe)
    }

    /// Toe centres, m.
    pub(super) fn toes_m(&self, robot: &Robot) -> [Vector3<f64>; LEGS] {
        let mut data = Data::new(&robot.model);
        std::array::from_fn(|leg| self.toe(robot, &mut data, leg).position)
    }

    /// Moved on the floor so that x and y are 0.
    pub(super) fn at_origin(mut self) -> Self {
        self.q[..2].fill(0.0);
        self
    }

    /// Turned on the floor about the origin.
    pub(super) fn turned(mut self, yaw_rad: f64) -> Self {
        let (sin, cos) = yaw_rad.sin_cos();
        let rotation = Matrix2::new(cos, -sin, sin, cos);
        for block in [&mut self.q, &mut self.v] {
            let turned = rotation * Vector2::new(block[0], block[1]);
            block[..2].copy_from_slice(turned.as_slice());
        }
        self.q[5] += yaw_rad;
        self
    }

    /// Refuses a state in which no step begins.
    pub(super) fn check(&self, robot: &Robot, request: &GaitRequest) -> Result<(), StateError> {
        let names = Names::of(robot);
        for (what, values) in [("", &self.q), ("the velocity of ", &self.v)] {
            if let Some(i) = values.iter().position(|value| !value.is_finite()) {
                let what = format!("{what}{}", names.coordinate(i));
                return Err(StateError::NotFinite { what, value: values[i] });
            }
        }
        let allowed_m = Tolerances::of(robot, request.torque_limit_nm).length_m;
        let mut data = Data::new(&robot.model);
        for leg in STANCE {
            let (toe, kinematics) = (names.toe(leg), self.toe(robot, &mut data, leg));
            let height_m = kinematics.position.z;
            if height_m.abs() > allowed_m {
                return Err(StateError::NotOnTheFloor { toe, height_m, allowed_m });
            }
            let speed_m_s = kinematics.velocity.norm();
            if speed_m_s > REST_M_S {
                return Err(StateError::Moves { toe, speed_m_s, allowed_m_s: REST_M_S });
            }
        }
        Ok(())
    }
}

/// Rates of roll, pitch, yaw of an angular velocity in the body's axes (R = R_z R_y R_x).
fn angle_rates(roll: f64, pitch: f64, [x, y, z]: [f64; 3]) -> [f64; 3] {
    let (sin, cos) = roll.sin_cos();
    let yaw_rate = (sin * y + cos * z) / pitch.cos();
    [x + pitch.sin() * yaw_rate, cos * y - sin * z, yaw_rate]
}
