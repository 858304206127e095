//! A robot.toml for a URDF: which joints are legs, what stands behind their names, and how the robot may stand.

mod legs;
mod posture;

use std::fmt::Write as _;

use rigid_body::{Description, Model};

use crate::{Robot, RobotError};
use legs::Found;
use posture::Postures;

/// Relative differences between the two sides that are tried, one after another.
const TOLERANCES: [f64; 7] = [1e-9, 1e-6, 1e-3, 0.01, 0.05, 0.1, 0.3];
/// Leg stiffness per weight and leg length, hip roll, hip pitch, knee.
const STIFFNESS: [f64; 3] = [1.5, 1.5, 2.0];
/// Stiffness over damping, 1/s.
const STIFFNESS_OVER_DAMPING: f64 = 45.0;
/// Drive torque per weight and leg length, where the URDF gives no usable one.
const TORQUE: f64 = 0.5;
/// More torque than this per weight and leg length is a URDF's way to say "no limit".
const MOST_TORQUE: f64 = 6.0;
/// Share of the drives' torque that plans may use.
const PLAN_SHARE: f64 = 0.8;
/// Joint velocity where the URDF gives no usable one, rad/s.
const VELOCITY_RAD_S: f64 = 20.0;
const GRAVITY_M_S2: f64 = 9.81;

/// A robot.toml and what a person must look at in it.
#[derive(Debug, Clone)]
pub struct Proposal {
    /// The text of robot.toml.
    pub toml: String,
    /// The robot that it describes.
    pub robot: Robot,
    /// What was assumed, a line each.
    pub look_at: Vec<String>,
}

/// A robot.toml for the URDF of a robot with four legs of three joints each; `file` is the URDF's name beside it,
/// `meshes` the folder that its meshes are looked for from, if that is another.
///
/// # Errors
///
/// If the URDF is refused, four legs are not found, they cannot stand, or the two sides are no mirror images.
pub fn propose(name: &str, file: &str, meshes: Option<&str>, urdf: &str) -> Result<Proposal, RobotError> {
    let mut description = Description::read(urdf)?;
    let found = legs::find(&mut description)?;
    let mut model = Model::floating_base(&description)?;
    for leg in &found.legs {
        let toe = model.frame_id(&leg.toe).expect("every link is a frame");
        crate::toe::centre_frame(&mut model, &description, toe);
    }
    let postures = posture::find(&model, &description, &found)?;
    let mut look_at = found.look_at.clone();
    look_at.extend(postures.look_at.iter().cloned());
    let scale_nm = model.total_mass() * GRAVITY_M_S2 * postures.height_m;
    let head = head([name, file], meshes, &description, &found, &postures, scale_nm, &mut look_at);
    let legs: String = (0..4).map(|leg| leg_text(leg, &found, &postures)).collect();
    let mut refused = None;
    for tolerance in TOLERANCES {
        let toml = format!("{}{legs}", head.replace("TOLERANCE", &tolerance.to_string()));
        match Robot::from_toml_str(&toml, urdf) {
            Ok(robot) => {
                if tolerance > 1e-3 {
                    look_at.push(format!(
                        "mirror.tolerance is {tolerance}: the URDF's two sides are no exact mirror images, plans take them for such"
                    ));
                }
                look_at.extend(robot.notes.iter().cloned());
                return Ok(Proposal { toml, robot, look_at });
            }
            Err(error @ RobotError::Mirror { .. }) => refused = Some(error),
            Err(error) => return Err(error),
        }
    }
    Err(refused.expect("the last tolerance was refused"))
}

fn list(values: &[f64; 3]) -> String {
    let [a, b, c] = values.map(|value| (value * 1e5).round() / 1e5);
    format!("[{a:?}, {b:?}, {c:?}]")
}

/// The text above the legs.
fn head(
    [name, file]: [&str; 2],
    meshes: Option<&str>,
    description: &Description,
    found: &Found,
    postures: &Postures,
    scale_nm: f64,
    look_at: &mut Vec<String>,
) -> String {
    let kp = STIFFNESS.map(|of| of * scale_nm);
    let (mut drive, mut velocity) = ([f64::INFINITY; 3], [f64::INFINITY; 3]);
    for (k, joint) in found.legs.iter().flat_map(|leg| leg.joints.iter().enumerate()) {
        let Some(limit) = description.joint(joint).map(|joint| &joint.limit) else { continue };
        if limit.effort > 0.0 && limit.effort < MOST_TORQUE * scale_nm {
            drive[k] = drive[k].min(limit.effort);
        }
        if limit.velocity > 0.0 && limit.velocity < 100.0 {
            velocity[k] = velocity[k].min(limit.velocity);
        }
    }
    for k in 0..3 {
        let which = ["hip roll", "hip pitch", "knee"][k];
        if drive[k].is_infinite() {
            drive[k] = TORQUE * scale_nm;
            look_at
                .push(format!("the {which} drives' torque: the URDF gives no usable one, {:.1} N m assumed", drive[k]));
        }
        if velocity[k].is_infinite() {
            velocity[k] = VELOCITY_RAD_S;
            look_at.push(format!(
                "the {which} drives' velocity: the URDF gives no usable one, {VELOCITY_RAD_S} rad/s assumed"
            ));
        }
    }
    look_at.push(
        "gains: scaled from the robot's weight and leg length; tune them before the robot itself walks".to_owned(),
    );
    let mut text = format!(
        "# Made by `tandem robot init`. SI units; lists of three are (hip roll, hip pitch, knee).\n\nformat = \"tandem-robot\"\nversion = 1\nname = \"{name}\"\nurdf = {file:?}\ntoe_radius_m = {:?}\n\n",
        postures.toe_radius_m
    );
    if let Some(folder) = meshes {
        let _ = write!(text, "# Where the URDF's meshes are looked for from.\nmeshes = {folder:?}\n\n");
    }
    let _ = write!(
        text,
        "[mirror]\nleg = [2, 3, 0, 1]\njoint_sign = {}\ntolerance = TOLERANCE\n\n[nominal]\nheight_m = {:.5}\nhalf_width_m = {:.5}\n\n",
        list(&found.joint_sign),
        postures.height_m,
        postures.half_width_m
    );
    let _ = write!(
        text,
        "[gains]\nkp_nm_per_rad = {}\nkd_nm_s_per_rad = {}\n\n[limits]\nplan_torque_nm = {}\ndrive_torque_nm = {}\nvelocity_rad_s = {}\n",
        list(&kp),
        list(&kp.map(|kp| kp / STIFFNESS_OVER_DAMPING)),
        list(&drive.map(|drive| PLAN_SHARE * drive)),
        list(&drive),
        list(&velocity)
    );
    if !found.locked.is_empty() {
        text += "\n# Joints that no leg has, held where they are: rad or m.\n[locked]\n";
        for (joint, position) in &found.locked {
            let _ = writeln!(text, "{joint:?} = {position:?}");
        }
    }
    text
}

fn leg_text(leg: usize, found: &Found, postures: &Postures) -> String {
    let about = &found.legs[leg];
    let name = joints::LEG_NAMES[leg];
    format!(
        "\n[[legs]]\nname = \"{name}\"\njoints = {:?}\ntoe_link = {:?}\nposition_min_rad = {}\nposition_max_rad = {}\nstand_rad = {}\nsit_rad = {}\n",
        about.joints,
        about.toe,
        list(&about.min_rad),
        list(&about.max_rad),
        list(&postures.stand_rad[leg]),
        list(&postures.sit_rad[leg])
    )
}
