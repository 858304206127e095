//! How the rear legs' joints are those of the front legs across.

use joints::mirrored_vector;
use nalgebra::Vector3;
use rigid_body::Data;

use crate::{Robot, RobotError};

/// Rear legs and the front legs across from them.
const ACROSS: [[usize; 2]; 2] = [[1, 2], [3, 0]];
/// Turns from the standing posture at which the two legs' motions are compared, rad.
const TURN_RAD: f64 = 0.3;
/// How far a rear toe may move otherwise than the front one: a share of the front one's way.
const MOTION_SHARE: f64 = 0.15;
/// How much higher a rear toe may be than the front one at the same angles, as a share of the nominal height, for the
/// two to be legs alike.
const ALIKE_SHARE: f64 = 0.005;

/// How far a rear leg's standing angles may be from its front leg's: beyond it the knee bends to the other side, rad.
const SAME_SIDE_RAD: f64 = 1.0;

/// See [`Robot::rear_offset_rad`].
pub(crate) fn offset_rad(robot: &Robot) -> Result<[f64; 6], RobotError> {
    let mut offset = [0.0; 6];
    let data = &mut Data::new(&robot.model);
    for (side, [rear, front]) in ACROSS.into_iter().enumerate() {
        let own = leg_offset(robot, data, rear, front);
        check_motion(robot, data, rear, front, own)?;
        check_limits(robot, rear, front, own)?;
        offset[3 * side..3 * side + 3].copy_from_slice(&own);
    }
    Ok(offset)
}

/// None where the same angles put the toe at the same height; else what brings one standing posture to the other:
/// shanks that are bent, for example, to the back in front and to the front behind.
fn leg_offset(robot: &Robot, data: &mut Data, rear: usize, front: usize) -> [f64; 3] {
    let stand = robot.legs[front].stand_rad;
    let as_front = robot.mirror.leg_image(&stand);
    let higher_m = robot.toe_from_hip_in(data, rear, &as_front).z - robot.toe_from_hip_in(data, front, &stand).z;
    let offset: [f64; 3] = std::array::from_fn(|k| robot.legs[rear].stand_rad[k] - as_front[k]);
    let same_side = offset.iter().all(|angle| angle.abs() <= SAME_SIDE_RAD);
    if same_side && higher_m.abs() <= ALIKE_SHARE * robot.nominal.height_m { [0.0; 3] } else { offset }
}

fn check_motion(robot: &Robot, data: &mut Data, rear: usize, front: usize, offset: [f64; 3]) -> Result<(), RobotError> {
    let stand = robot.legs[front].stand_rad;
    let mut ways = |turn: [f64; 3]| {
        let mut way = |leg: usize, from: [f64; 3], to: [f64; 3]| -> Vector3<f64> {
            robot.toe_from_hip_in(data, leg, &to) - robot.toe_from_hip_in(data, leg, &from)
        };
        let of_rear = |joints: [f64; 3]| {
            let joints = robot.mirror.leg_image(&joints);
            std::array::from_fn(|k| joints[k] + offset[k])
        };
        let turned: [f64; 3] = std::array::from_fn(|k| stand[k] + turn[k]);
        let flip = Vector3::from(mirrored_vector([1.0; 3]));
        (way(front, stand, turned), way(rear, of_rear(stand), of_rear(turned)).component_mul(&flip))
    };
    for (joint, sign) in [(1, 1.0), (1, -1.0), (2, 1.0), (2, -1.0)] {
        let mut turn = [0.0; 3];
        turn[joint] = sign * TURN_RAD;
        let (of_front, of_rear) = ways(turn);
        if (of_front - of_rear).norm() > MOTION_SHARE * of_front.norm() {
            return Err(RobotError::RearDiffers {
                rear: robot.legs[rear].name.clone(),
                front: robot.legs[front].name.clone(),
                what: format!(
                    "standing at {:?} and {stand:?} rad, the same turn of the {} by {:.1} rad moves their toes by \
                     ({:.3}, {:.3}) and ({:.3}, {:.3}) m ahead and up",
                    robot.legs[rear].stand_rad,
                    ["hip roll", "hip pitch", "knee"][joint],
                    turn[joint],
                    of_rear.x,
                    of_rear.z,
                    of_front.x,
                    of_front.z
                ),
            });
        }
    }
    Ok(())
}

fn check_limits(robot: &Robot, rear: usize, front: usize, offset: [f64; 3]) -> Result<(), RobotError> {
    let (of_rear, of_front) = (&robot.legs[rear], &robot.legs[front]);
    let (low, high) =
        (robot.mirror.leg_image(&of_front.position_min_rad), robot.mirror.leg_image(&of_front.position_max_rad));
    for k in 0..3 {
        let (low, high) = (low[k].min(high[k]) + offset[k], low[k].max(high[k]) + offset[k]);
        let (own_low, own_high) = (of_rear.position_min_rad[k], of_rear.position_max_rad[k]);
        if low.max(own_low) >= high.min(own_high) {
            return Err(RobotError::RearDiffers {
                rear: of_rear.name.clone(),
                front: of_front.name.clone(),
                what: format!(
                    "the limits of the {}, {own_low} to {own_high} and {low} to {high} rad, have nothing in common",
                    ["hip roll", "hip pitch", "knee"][k]
                ),
            });
        }
    }
    Ok(())
}
