//! A quadruped's description: its model, legs, toes, mirror, nominal posture, gains and limits.
//!
//! Legs are numbered 0 front-left, 1 rear-left, 2 front-right, 3 rear-right; a leg's joints are hip
//! roll, hip pitch, knee. Vectors of twelve joints are in the order leg·3 + joint, and so are the
//! coordinates of [`Robot::model`] after its first six.
//!
//! A robot is a folder `config/robots/NAME/` with a `robot.toml` and a URDF. [`Robot::from_toml_str`]
//! turns their texts into a checked [`Robot`]; [`Robot::load`] also opens the files.

mod against_urdf;
mod encoding;
mod error;
mod folder;
mod kinematics;
mod leg_kinematics;
mod mirror;
mod parse;
mod propose;
mod rear;
mod toe;

use std::path::{Path, PathBuf};

use rigid_body::{Data, Description, FrameId, Model, forward_kinematics, frame_position};

pub use error::RobotError;
pub use folder::{DEFAULT_FOLDER, FOLDER_TEXT, NotFound, find};
pub use joints::{Mirror, mirrored_vector};
pub use leg_kinematics::{LegKinematics, LegSolution, ToeKinematics};
pub use propose::{Proposal, propose};

/// Everything that the software knows about one quadruped.
#[derive(Debug, Clone)]
pub struct Robot {
    /// The robot's name, a word.
    pub name: String,
    /// The text of its URDF.
    pub urdf: String,
    /// The URDF as it was read, with the joints locked that robot.toml locks.
    pub description: Description,
    /// The folder that meshes are looked for from: robot.toml's `meshes`, else the one that it was loaded from.
    pub folder: Option<PathBuf>,
    /// What was changed on the way from the files to here, a line each, for a person to read.
    pub notes: Vec<String>,
    /// The whole robot, 18 coordinates: x, y, z, roll, pitch, yaw, then leg·3 + joint.
    pub model: Model,
    /// Legs 0 to 3.
    pub legs: [Leg; 4],
    /// Radius of the toe's sphere, m. The toe's frame is the sphere's centre.
    pub toe_radius_m: f64,
    /// The left–right symmetry.
    pub mirror: Mirror,
    /// The posture that gaits are designed about.
    pub nominal: Nominal,
    /// Gains of the tracking law.
    pub gains: Gains,
    /// Torque and velocity limits.
    pub limits: Limits,
    /// What stands behind each joint, for the simulation.
    pub drives: Drives,
}

/// One leg. Triples are hip roll, hip pitch, knee.
#[derive(Debug, Clone)]
pub struct Leg {
    /// Its name, a prefix such as `front_left`.
    pub name: String,
    /// Names of its joints in the URDF.
    pub joints: [String; 3],
    /// The toe's frame in [`Robot::model`] and in every model cut from it.
    pub toe: FrameId,
    /// Lowest joint positions allowed, rad.
    pub position_min_rad: [f64; 3],
    /// Highest joint positions allowed, rad.
    pub position_max_rad: [f64; 3],
    /// Joint positions standing, rad.
    pub stand_rad: [f64; 3],
    /// Joint positions sitting on the floor, rad.
    pub sit_rad: [f64; 3],
}

/// The posture that gaits are designed about.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nominal {
    /// Height of the hip axes above the toes' centres, m.
    pub height_m: f64,
    /// Lateral distance of a stance toe from the middle plane, m.
    pub half_width_m: f64,
}

/// Gains of the tracking law τ = kp (q_des − q) + kd (v_des − v), for hip roll, hip pitch, knee.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gains {
    /// Stiffness, N m/rad.
    pub kp_nm_per_rad: [f64; 3],
    /// Damping, N m s/rad.
    pub kd_nm_s_per_rad: [f64; 3],
}

/// Limits of hip roll, hip pitch, knee.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Torque that a plan may use, N m.
    pub plan_torque_nm: [f64; 3],
    /// Torque that the drives may give, N m.
    pub drive_torque_nm: [f64; 3],
    /// Joint velocity, rad/s.
    pub velocity_rad_s: [f64; 3],
}

/// What moves and brakes with a joint: hip roll, hip pitch, knee. Where robot.toml says nothing, damping and friction
/// are those of the URDF's `<dynamics>`. The simulation has them; plans do not.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Drives {
    /// Inertia of the rotor as seen at the joint (times the gear ratio squared), kg m².
    pub rotor_inertia_kg_m2: [f64; 3],
    /// Viscous damping, N m s/rad.
    pub damping_nm_s_per_rad: Option<[f64; 3]>,
    /// Dry friction, N m.
    pub friction_nm: Option<[f64; 3]>,
}

impl Robot {
    /// A robot from the text of its `robot.toml` and of its URDF.
    ///
    /// # Errors
    ///
    /// One [`RobotError`] naming what is wrong: text that does not parse, a field missing or unknown,
    /// numbers out of range, joints or toes that the URDF does not have, or two sides of the robot that
    /// are not mirror images.
    pub fn from_toml_str(toml: &str, urdf: &str) -> Result<Robot, RobotError> {
        let robot = parse::robot(toml, urdf)?;
        against_urdf::check_places(&robot)?;
        mirror::check(&robot, parse::mirror_tolerance(toml)?)?;
        against_urdf::check_posture(&robot)?;
        Ok(robot)
    }

    /// A robot from its folder, which holds `robot.toml` and the URDF that it names.
    ///
    /// # Errors
    ///
    /// As [`Robot::from_toml_str`], or if a file cannot be read or is too large.
    pub fn load(folder: &Path) -> Result<Robot, RobotError> {
        let (toml, mut notes) = parse::read(&folder.join("robot.toml"))?;
        let (urdf, more) = parse::read(&folder.join(parse::urdf_file(&toml)?))?;
        let mut robot = Self::from_toml_str(&toml, &urdf)?;
        notes.extend(more);
        notes.append(&mut robot.notes);
        let meshes = robot.folder.take().map_or_else(|| folder.to_owned(), |meshes| folder.join(meshes));
        Ok(Self { folder: Some(meshes), notes, ..robot })
    }

    /// The text of a file of bounded size, whatever encoding of Unicode it has, and a line if that is not UTF-8.
    ///
    /// # Errors
    ///
    /// If it cannot be read, is too large, or its encoding is not known.
    pub fn read_text(path: &Path) -> Result<(String, Option<String>), RobotError> {
        parse::read(path).map(|(text, notes)| (text, notes.into_iter().next()))
    }

    /// The ball of a toe's link, by number among the shapes that touch: the only ball there is.
    pub fn toe_ball(&self, link: &urdf_rs::Link) -> Option<usize> {
        let (ball, _) = toe::ball(link)?;
        link.collision.iter().position(|shape| std::ptr::eq(shape, ball))
    }

    /// Height of the leg's hip-roll joint in the torso's axes, m.
    pub(crate) fn hip_height_m(&self, leg: &Leg) -> f64 {
        let mut data = Data::new(&self.model);
        let zero = [0.0; 18];
        forward_kinematics(&self.model, &mut data, &zero, &zero, &zero);
        let dof = self.model.joint_index(&leg.joints[0]).expect("a leg's joints are the model's");
        let hip = self.model.frame_id(self.model.link_name(dof)).expect("a moving link is a frame");
        frame_position(&self.model, &data, hip).z
    }

    /// What is added to the angles of the front leg across, mirrored, to give those of rear legs 1 and 3, rad, in plans
    /// that have the rear legs do as the front ones across do: 0 for legs alike, else what brings one standing posture
    /// to the other.
    ///
    /// # Errors
    ///
    /// [`RobotError::RearDiffers`] if the same turns move the toes otherwise, as with knees that point to different
    /// sides, or the limits have nothing in common.
    pub fn rear_offset_rad(&self) -> Result<[f64; 6], RobotError> {
        rear::offset_rad(self)
    }

    /// Names of the twelve joints, leg·3 + joint.
    pub fn joint_names(&self) -> [String; 12] {
        std::array::from_fn(|i| self.legs[i / 3].joints[i % 3].clone())
    }

    /// Joint positions standing, rad, leg·3 + joint.
    pub fn stand_rad(&self) -> [f64; 12] {
        self.each_joint(|leg| &leg.stand_rad)
    }

    /// Joint positions sitting, rad, leg·3 + joint.
    pub fn sit_rad(&self) -> [f64; 12] {
        self.each_joint(|leg| &leg.sit_rad)
    }

    /// Lowest joint positions allowed, rad, leg·3 + joint.
    pub fn position_min_rad(&self) -> [f64; 12] {
        self.each_joint(|leg| &leg.position_min_rad)
    }

    /// Highest joint positions allowed, rad, leg·3 + joint.
    pub fn position_max_rad(&self) -> [f64; 12] {
        self.each_joint(|leg| &leg.position_max_rad)
    }

    fn each_joint(&self, of: impl Fn(&Leg) -> &[f64; 3]) -> [f64; 12] {
        std::array::from_fn(|i| of(&self.legs[i / 3])[i % 3])
    }

    /// The model with only the named legs, in that order, and a share of the torso: the paper's
    /// bipeds (section II-B) are `biped([0, 2], share)` and `biped([1, 3], 1.0 - share)`.
    ///
    /// # Errors
    ///
    /// If the share is not from 0 to 1 or a leg is named twice.
    ///
    /// # Panics
    ///
    /// If a leg is not 0 to 3.
    pub fn biped(&self, legs: [usize; 2], torso_share: f64) -> Result<Model, RobotError> {
        let joints: Vec<&String> = legs.iter().flat_map(|&leg| &self.legs[leg].joints).collect();
        self.model.subtree(&joints, torso_share).map_err(RobotError::Model)
    }
}
