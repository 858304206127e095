//! The text of `robot.toml` to a [`Robot`].

use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Component, Path};

use rigid_body::{Description, JointKind, Model};
use serde::Deserialize;

use crate::{Drives, Gains, Leg, Limits, Mirror, Nominal, Robot, RobotError, against_urdf, toe};

/// Longest file that is read. A robot's files are far below it.
const LIMIT_BYTES: u64 = 16 << 20;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RobotFile {
    // Checked beforehand, see `file`.
    #[serde(rename = "format")]
    _format: String,
    #[serde(rename = "version")]
    _version: u32,
    name: String,
    urdf: String,
    toe_radius_m: f64,
    /// Folder that the URDF's meshes are looked for from, where it is not the robot's.
    meshes: Option<String>,
    mirror: MirrorFile,
    nominal: NominalFile,
    gains: GainsFile,
    limits: LimitsFile,
    /// Joints of the URDF that no leg has, and where each is held, rad or m.
    #[serde(default)]
    locked: BTreeMap<String, f64>,
    drives: Option<DrivesFile>,
    legs: Vec<LegFile>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DrivesFile {
    rotor_inertia_kg_m2: Option<Vec<f64>>,
    damping_nm_s_per_rad: Option<Vec<f64>>,
    friction_nm: Option<Vec<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MirrorFile {
    leg: Vec<usize>,
    joint_sign: Vec<f64>,
    /// Relative difference allowed between the two sides. Some published robots are not quite
    /// symmetric.
    #[serde(default = "default_tolerance")]
    tolerance: f64,
}

fn default_tolerance() -> f64 {
    1e-9
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct NominalFile {
    height_m: f64,
    half_width_m: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GainsFile {
    kp_nm_per_rad: Vec<f64>,
    kd_nm_s_per_rad: Vec<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LimitsFile {
    plan_torque_nm: Vec<f64>,
    drive_torque_nm: Vec<f64>,
    velocity_rad_s: Vec<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LegFile {
    name: String,
    joints: Vec<String>,
    toe_link: String,
    position_min_rad: Vec<f64>,
    position_max_rad: Vec<f64>,
    stand_rad: Vec<f64>,
    sit_rad: Vec<f64>,
}

/// The text of a file of bounded size, and a line if it had to be converted.
pub(crate) fn read(path: &Path) -> Result<(String, Vec<String>), RobotError> {
    let fail = |reason: String| RobotError::File { path: path.display().to_string(), reason };
    let file = std::fs::File::open(path).map_err(|error| fail(error.to_string()))?;
    let mut bytes = Vec::new();
    let length = file.take(LIMIT_BYTES + 1).read_to_end(&mut bytes).map_err(|error| fail(error.to_string()))?;
    if length as u64 > LIMIT_BYTES {
        return Err(fail(format!("it is larger than {LIMIT_BYTES} bytes, expected a small text")));
    }
    let (text, note) = crate::encoding::decode(&bytes).map_err(fail)?;
    Ok((text, note.into_iter().map(|note| format!("{}: {note}", path.display())).collect()))
}

fn file(toml: &str) -> Result<RobotFile, RobotError> {
    // The version first: another version's fields would only give a confusing message.
    #[derive(Deserialize)]
    struct Header {
        format: String,
        version: u32,
    }
    if toml.len() as u64 > LIMIT_BYTES {
        return Err(RobotError::Toml(format!("it is {} bytes long, expected at most {LIMIT_BYTES}", toml.len())));
    }
    let parse_error = |error: toml::de::Error| RobotError::Toml(error.to_string());
    let Header { format, version } = toml::from_str(toml).map_err(parse_error)?;
    if format != "tandem-robot" || version != 1 {
        return Err(RobotError::Version { format, version });
    }
    toml::from_str(toml).map_err(parse_error)
}

pub(crate) fn mirror_tolerance(toml: &str) -> Result<f64, RobotError> {
    let tolerance = file(toml)?.mirror.tolerance;
    in_range("mirror.tolerance", tolerance, 0.0, 1.0)
}

/// Name of the URDF, a file beside the robot file.
pub(crate) fn urdf_file(toml: &str) -> Result<String, RobotError> {
    let name = file(toml)?.urdf;
    let mut parts = Path::new(&name).components();
    match (parts.next(), parts.next()) {
        (Some(Component::Normal(_)), None) => Ok(name),
        _ => Err(RobotError::Field {
            field: "urdf".to_owned(),
            found: format!("'{name}'"),
            expected: "the name of a file in the robot's folder".to_owned(),
        }),
    }
}

pub(crate) fn robot(toml: &str, urdf: &str) -> Result<Robot, RobotError> {
    let file = file(toml)?;
    let is_word =
        |name: &str| !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-');
    if !is_word(&file.name) {
        return Err(RobotError::Field {
            field: "name".to_owned(),
            found: format!("'{}'", file.name),
            expected: "a word of letters, digits, _ and -".to_owned(),
        });
    }
    let legs: [LegFile; 4] = file.legs.try_into().map_err(|legs: Vec<LegFile>| RobotError::Field {
        field: "legs".to_owned(),
        found: format!("a list of {}", legs.len()),
        expected: "four: front-left, rear-left, front-right, rear-right".to_owned(),
    })?;
    let mut description = Description::read(urdf)?;
    lock(&mut description, &file.locked, &legs)?;
    let mut notes = description.notes().to_vec();
    let in_file_order = Model::floating_base(&description)?;
    notes.extend_from_slice(in_file_order.notes());
    let mut model = model(&legs, &in_file_order)?;
    let legs = {
        let mut done = Vec::with_capacity(4);
        for (i, leg) in legs.into_iter().enumerate() {
            done.push(self::leg(leg, i, &model, &description, &mut notes)?);
        }
        <[Leg; 4]>::try_from(done).expect("four legs were converted")
    };
    let toe_radius_m = in_range("toe_radius_m", file.toe_radius_m, 0.0, 1.0)?;
    for leg in &legs {
        toe::centre_frame(&mut model, &description, leg.toe);
    }
    notes.extend(other_radius(toe_radius_m, &legs, &model, &description));
    let mirror = Mirror {
        leg: mirror_legs(&file.mirror.leg)?,
        sign: triple("mirror.joint_sign", &file.mirror.joint_sign, |x| x.abs() == 1.0, "±1")?,
    };
    let positive = |field: &str, values: &[f64]| triple(field, values, |x| x > 0.0, "a positive number");
    let mut limits = Limits {
        plan_torque_nm: positive("limits.plan_torque_nm", &file.limits.plan_torque_nm)?,
        drive_torque_nm: positive("limits.drive_torque_nm", &file.limits.drive_torque_nm)?,
        velocity_rad_s: positive("limits.velocity_rad_s", &file.limits.velocity_rad_s)?,
    };
    against_urdf::narrow_limits(&mut limits, &legs, &description, &mut notes)?;
    Ok(Robot {
        name: file.name,
        urdf: urdf.to_owned(),
        description,
        folder: file.meshes.map(Into::into),
        notes,
        toe_radius_m,
        mirror,
        nominal: Nominal {
            height_m: in_range("nominal.height_m", file.nominal.height_m, 0.01, 10.0)?,
            half_width_m: in_range("nominal.half_width_m", file.nominal.half_width_m, 0.0, 10.0)?,
        },
        gains: Gains {
            kp_nm_per_rad: positive("gains.kp_nm_per_rad", &file.gains.kp_nm_per_rad)?,
            kd_nm_s_per_rad: positive("gains.kd_nm_s_per_rad", &file.gains.kd_nm_s_per_rad)?,
        },
        limits,
        drives: drives(file.drives.as_ref())?,
        model,
        legs,
    })
}

/// Locks the joints that robot.toml names.
fn lock(description: &mut Description, locked: &BTreeMap<String, f64>, legs: &[LegFile; 4]) -> Result<(), RobotError> {
    for (joint, &position) in locked {
        let fail = |problem: String| RobotError::Locked { joint: joint.clone(), problem };
        if let Some(leg) = legs.iter().find(|leg| leg.joints.contains(joint)) {
            return Err(fail(format!("the leg '{}' has it, which must move: remove the line", leg.name)));
        }
        description.lock(joint, position).map_err(|error| fail(error.to_string()))?;
    }
    Ok(())
}

/// A line where the toes' balls have another radius in the URDF.
fn other_radius(toe_radius_m: f64, legs: &[Leg; 4], model: &Model, description: &Description) -> Option<String> {
    let (link, radius) = legs.iter().find_map(|leg| {
        let link = toe::link(description, model.frame_name(leg.toe))?;
        let (_, radius) = toe::ball(link)?;
        ((radius - toe_radius_m).abs() > 0.02 * radius).then_some((&link.name, radius))
    })?;
    Some(format!(
        "robot.toml's toe_radius_m, {toe_radius_m}, is used in place of {radius}, the radius of the ball of the URDF's link '{link}'"
    ))
}

fn drives(file: Option<&DrivesFile>) -> Result<Drives, RobotError> {
    let Some(file) = file else { return Ok(Drives::default()) };
    let given = |name: &str, values: &Option<Vec<f64>>| {
        let read = |values: &Vec<f64>| triple(name, values, |x| x >= 0.0, "a number not below zero");
        values.as_ref().map(read).transpose()
    };
    Ok(Drives {
        rotor_inertia_kg_m2: given("drives.rotor_inertia_kg_m2", &file.rotor_inertia_kg_m2)?.unwrap_or_default(),
        damping_nm_s_per_rad: given("drives.damping_nm_s_per_rad", &file.damping_nm_s_per_rad)?,
        friction_nm: given("drives.friction_nm", &file.friction_nm)?,
    })
}

/// The model with its coordinates in the order of the legs.
fn model(legs: &[LegFile; 4], in_file_order: &Model) -> Result<Model, RobotError> {
    let movable = &in_file_order.joint_names()[6..];
    for leg in legs {
        if leg.joints.len() != 3 {
            return Err(RobotError::NotALeg {
                leg: leg.name.clone(),
                problem: format!("it has {} joints", leg.joints.len()),
            });
        }
        if let Some(joint) = leg.joints.iter().find(|joint| !movable.contains(joint)) {
            return Err(RobotError::UnknownJoint {
                leg: leg.name.clone(),
                joint: joint.clone(),
                known: movable.join(", "),
            });
        }
    }
    let joints: Vec<&String> = legs.iter().flat_map(|leg| &leg.joints).collect();
    if let Some(joint) = movable.iter().find(|joint| !joints.contains(joint)) {
        return Err(RobotError::ExtraJoint { joint: joint.clone() });
    }
    Ok(in_file_order.subtree(&joints, 1.0)?)
}

fn leg(
    file: LegFile,
    number: usize,
    model: &Model,
    description: &Description,
    notes: &mut Vec<String>,
) -> Result<Leg, RobotError> {
    let not_a_leg = |problem: String| RobotError::NotALeg { leg: file.name.clone(), problem };
    let first = 6 + 3 * number;
    for dof in first..first + 3 {
        let name = &model.joint_names()[dof];
        if model.joint_kind(dof) != JointKind::Revolute {
            return Err(not_a_leg(format!("joint '{name}' is prismatic")));
        }
        // The joint above a hip is the torso's last, roll.
        let above = if dof == first { 3 } else { dof - 1 };
        if model.parent_dof(dof) != Some(above) {
            return Err(not_a_leg(format!(
                "joint '{name}' does not hang from {}",
                if dof == first { "the torso" } else { &model.joint_names()[above] }
            )));
        }
    }
    let toe = model
        .frame_id(&file.toe_link)
        .ok_or_else(|| RobotError::UnknownToe { leg: file.name.clone(), link: file.toe_link.clone() })?;
    if model.frame_dof(toe) != Some(first + 2) {
        return Err(not_a_leg(format!("its toe '{}' does not move with '{}'", file.toe_link, file.joints[2])));
    }
    let field = |name: &str| format!("legs[{number}].{name}");
    let finite = |name: &str, values: &[f64]| triple(&field(name), values, |_| true, "a finite number");
    let position_min_rad = finite("position_min_rad", &file.position_min_rad)?;
    let position_max_rad = finite("position_max_rad", &file.position_max_rad)?;
    for k in 0..3 {
        if position_min_rad[k] >= position_max_rad[k] {
            return Err(RobotError::Field {
                field: format!("{}[{k}]", field("position_max_rad")),
                found: position_max_rad[k].to_string(),
                expected: format!("above position_min_rad[{k}], {} (are the two swapped?)", position_min_rad[k]),
            });
        }
    }
    let stand_rad = finite("stand_rad", &file.stand_rad)?;
    // Folded on the floor a leg may rest beyond the range that walking uses.
    let sit_rad = finite("sit_rad", &file.sit_rad)?;
    let joints = <[String; 3]>::try_from(file.joints).expect("three joints were counted");
    let mut leg = Leg { name: file.name, joints, toe, position_min_rad, position_max_rad, stand_rad, sit_rad };
    against_urdf::check_radians(&leg, number)?;
    against_urdf::narrow_positions(&mut leg, number, description, notes)?;
    for k in 0..3 {
        let range = (leg.position_min_rad[k], leg.position_max_rad[k]);
        in_range(&format!("legs[{number}].stand_rad[{k}]"), stand_rad[k], range.0, range.1)?;
    }
    Ok(leg)
}

fn mirror_legs(values: &[usize]) -> Result<[usize; 4], RobotError> {
    let fail = || RobotError::Field {
        field: "mirror.leg".to_owned(),
        found: format!("{values:?}"),
        expected: "four legs 0 to 3 that swap in pairs, such as [2, 3, 0, 1]".to_owned(),
    };
    let legs = <[usize; 4]>::try_from(values).map_err(|_| fail())?;
    let swaps = (0..4).all(|i| legs[i] < 4 && legs[legs[i]] == i && legs[i] != i);
    if swaps { Ok(legs) } else { Err(fail()) }
}

fn in_range(field: &str, value: f64, min: f64, max: f64) -> Result<f64, RobotError> {
    if (min..=max).contains(&value) {
        Ok(value)
    } else {
        Err(RobotError::Field {
            field: field.to_owned(),
            found: value.to_string(),
            expected: format!("a number from {min} to {max}"),
        })
    }
}

fn triple(field: &str, values: &[f64], accept: impl Fn(f64) -> bool, expected: &str) -> Result<[f64; 3], RobotError> {
    let triple = <[f64; 3]>::try_from(values).map_err(|_| RobotError::Field {
        field: field.to_owned(),
        found: format!("a list of {}", values.len()),
        expected: "three numbers: hip roll, hip pitch, knee".to_owned(),
    })?;
    for (k, &value) in triple.iter().enumerate() {
        if !(value.is_finite() && accept(value)) {
            return Err(RobotError::Field {
                field: format!("{field}[{k}]"),
                found: value.to_string(),
                expected: expected.to_owned(),
            });
        }
    }
    Ok(triple)
}
