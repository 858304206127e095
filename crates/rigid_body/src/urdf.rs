//! From a URDF's text to a [`Model`].

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::description::Description;
use crate::error::ModelError;
use crate::inertia::Inertia;
use crate::joint::{BASE_JOINTS, Frame, Joint, JointKind};
use crate::model::Model;

impl Model {
    /// A robot that floats: six coordinates of its root link, then one for each movable joint in the
    /// order of the file. Fixed joints are merged, every link becomes a frame.
    ///
    /// # Errors
    ///
    /// One clear [`ModelError`] for a text that is no URDF, is not a tree, or holds numbers that no
    /// body can have.
    pub fn floating_base_from_urdf(urdf: &str) -> Result<Model, ModelError> {
        Self::floating_base(&Description::read(urdf)?)
    }

    /// As [`Model::floating_base_from_urdf`], of a description that was read before: with joints locked, for example.
    ///
    /// # Errors
    ///
    /// As [`Model::floating_base_from_urdf`].
    pub fn floating_base(description: &Description) -> Result<Model, ModelError> {
        from_urdf(&description.robot, true)
    }

    /// A robot whose root link is fixed to the world: one coordinate for each movable joint.
    ///
    /// # Errors
    ///
    /// As [`Model::floating_base_from_urdf`].
    pub fn fixed_base_from_urdf(urdf: &str) -> Result<Model, ModelError> {
        from_urdf(&Description::read(urdf)?.robot, false)
    }
}

/// How far a body's largest moment of inertia may exceed the sum of the others, as a share of it, to be taken for a
/// measurement's error, which is corrected with a line.
const LACKING_SHARE: f64 = 0.1;

fn from_urdf(robot: &urdf_rs::Robot, floating: bool) -> Result<Model, ModelError> {
    let mut links: BTreeMap<&str, &urdf_rs::Link> = BTreeMap::new();
    for link in &robot.links {
        if links.insert(&link.name, link).is_some() {
            return Err(ModelError::Duplicate { kind: "link", name: link.name.clone() });
        }
    }
    let mut joint_names = BTreeSet::new();
    let mut joint_above: BTreeMap<&str, &urdf_rs::Joint> = BTreeMap::new();
    let mut joints_below: BTreeMap<&str, Vec<&urdf_rs::Joint>> = BTreeMap::new();
    for joint in &robot.joints {
        if !joint_names.insert(joint.name.as_str()) {
            return Err(ModelError::Duplicate { kind: "joint", name: joint.name.clone() });
        }
        for link in [&joint.parent.link, &joint.child.link] {
            if !links.contains_key(link.as_str()) {
                return Err(ModelError::UnknownLink { joint: joint.name.clone(), link: link.clone() });
            }
        }
        if joint_above.insert(&joint.child.link, joint).is_some() {
            return Err(ModelError::Loop { joint: joint.name.clone(), link: joint.child.link.clone() });
        }
        joints_below.entry(&joint.parent.link).or_default().push(joint);
    }
    let mut roots = robot.links.iter().filter(|link| !joint_above.contains_key(link.name.as_str()));
    let Some(root) = roots.next() else {
        return Err(match robot.joints.first() {
            Some(joint) => ModelError::Loop { joint: joint.name.clone(), link: joint.child.link.clone() },
            None => ModelError::NoRoot { links: robot.links.len() },
        });
    };
    if let Some(second) = roots.next() {
        return Err(ModelError::TwoRoots { first: root.name.clone(), second: second.name.clone() });
    }

    let mut joints = if floating { floating_base(&root.name) } else { Vec::new() };
    let torso = joints.len().checked_sub(1);
    let mut frames = Vec::with_capacity(robot.links.len());
    // Depth first, in the order of the file. Each entry: a link, the joint above it, the body that the
    // joint hangs from, and the link's placement in that body at q = 0.
    let at_origin = (Matrix3::identity(), Vector3::zeros());
    let mut pending = vec![(root.name.as_str(), None::<&urdf_rs::Joint>, torso, at_origin)];
    while let Some((link, above, mut body, mut placement)) = pending.pop() {
        if let Some(joint) = above
            && let Some(kind) = joint_kind(joint)?
        {
            let dof = joints.len();
            let axis = joint_axis(joint)?;
            joints.push(Joint::new(&joint.name, body, dof, kind, placement, axis, link));
            body = Some(dof);
            placement = at_origin;
        }
        let (rotation, translation) = placement;
        frames.push(Frame { name: link.to_owned(), body, rotation, translation });
        let inertia = link_inertia(links[link])?.placed(&rotation, &translation);
        if let Some(body) = body {
            joints[body].inertia = joints[body].inertia.plus(&inertia);
        }
        for joint in joints_below.get(link).into_iter().flatten().rev() {
            let (r, p) = pose(&joint.origin, || format!("joint '{}'", joint.name))?;
            let placement = (rotation * r, translation + rotation * p);
            pending.push((&joint.child.link, Some(*joint), body, placement));
        }
    }
    // Links that the walk did not meet hang from a ring of joints.
    if frames.len() < robot.links.len() {
        let met: BTreeSet<&str> = frames.iter().map(|frame| frame.name.as_str()).collect();
        let ring = robot.joints.iter().find(|joint| !met.contains(joint.child.link.as_str()));
        let joint = ring.expect("a link that was not met has a joint above it");
        return Err(ModelError::Loop { joint: joint.name.clone(), link: joint.child.link.clone() });
    }
    let notes = check_inertias(&mut joints[torso.unwrap_or(0)..])?;
    let mut model = Model::assemble(joints, frames, torso);
    model.notes = notes;
    Ok(model)
}

/// Every moving body has a mass and moments of inertia that a body can have; what was corrected is reported.
fn check_inertias(joints: &mut [Joint]) -> Result<Vec<String>, ModelError> {
    let mut notes = Vec::new();
    for joint in joints {
        if joint.inertia.mass_kg == 0.0 {
            return Err(ModelError::MissingInertial { link: joint.link.clone() });
        }
        // Of the body, not of each link: published files give cameras and the like careless inertias, which do no harm
        // once they are part of a torso.
        let (moments, slack) = principal_moments(&joint.inertia.rotational_kg_m2);
        let lacks = moments[2] - moments[0] - moments[1];
        if moments[2] <= 0.0 || lacks > LACKING_SHARE * moments[2] {
            return Err(ModelError::BadInertia { link: joint.link.clone(), moments });
        }
        if lacks > slack {
            joint.inertia.rotational_kg_m2 += Matrix3::identity() * lacks;
            notes.push(format!(
                "link '{}' has the principal moments of inertia {moments:?} kg m², the last larger than the other two \
                 together: {lacks:.1e} kg m² is added to each",
                joint.link
            ));
        }
    }
    Ok(notes)
}

/// The chain x, y, z, yaw, pitch, roll without masses.
fn floating_base(root: &str) -> Vec<Joint> {
    use JointKind::{Prismatic, Revolute};
    let chain = [
        (0, Prismatic, Vector3::x()),
        (1, Prismatic, Vector3::y()),
        (2, Prismatic, Vector3::z()),
        (5, Revolute, Vector3::z()),
        (4, Revolute, Vector3::y()),
        (3, Revolute, Vector3::x()),
    ];
    let placement = (Matrix3::identity(), Vector3::zeros());
    chain
        .into_iter()
        .enumerate()
        .map(|(i, (dof, kind, axis))| {
            let parent = i.checked_sub(1);
            Joint::new(BASE_JOINTS[dof], parent, dof, kind, placement, axis, root)
        })
        .collect()
}

/// How the joint moves; none if it is fixed.
fn joint_kind(joint: &urdf_rs::Joint) -> Result<Option<JointKind>, ModelError> {
    use urdf_rs::JointType;
    let unsupported =
        |found: &str| Err(ModelError::UnsupportedJoint { joint: joint.name.clone(), found: found.to_owned() });
    if joint.mimic.is_some() {
        return unsupported("mimic");
    }
    match joint.joint_type {
        JointType::Revolute | JointType::Continuous => Ok(Some(JointKind::Revolute)),
        JointType::Prismatic => Ok(Some(JointKind::Prismatic)),
        JointType::Fixed => Ok(None),
        JointType::Floating => unsupported("floating"),
        JointType::Planar => unsupported("planar"),
        JointType::Spherical => unsupported("spherical"),
    }
}

fn joint_axis(joint: &urdf_rs::Joint) -> Result<Vector3<f64>, ModelError> {
    let axis = vector(&joint.axis.xyz, "axis", || format!("joint '{}'", joint.name))?;
    let length = axis.norm();
    // The direction must be a usable one: a length near zero or beyond squaring is a mistake in the file.
    if !(1e-6..1e6).contains(&length) {
        return Err(ModelError::BadAxis { joint: joint.name.clone(), length });
    }
    Ok(axis / length)
}

fn finite(value: f64, field: &'static str, owner: impl FnOnce() -> String) -> Result<f64, ModelError> {
    if value.is_finite() { Ok(value) } else { Err(ModelError::NotFinite { owner: owner(), field, value }) }
}

fn vector(xyz: &urdf_rs::Vec3, field: &'static str, owner: impl Fn() -> String) -> Result<Vector3<f64>, ModelError> {
    for &value in xyz.iter() {
        finite(value, field, &owner)?;
    }
    Ok(Vector3::from(**xyz))
}

fn pose(pose: &urdf_rs::Pose, owner: impl Fn() -> String) -> Result<(Matrix3<f64>, Vector3<f64>), ModelError> {
    let rpy = vector(&pose.rpy, "origin rpy", &owner)?;
    let xyz = vector(&pose.xyz, "origin xyz", &owner)?;
    Ok((*Rotation3::from_euler_angles(rpy.x, rpy.y, rpy.z).matrix(), xyz))
}

/// A link's inertia in the link's frame. A link without an `<inertial>` is a frame without mass.
fn link_inertia(link: &urdf_rs::Link) -> Result<Inertia, ModelError> {
    let owner = || format!("link '{}'", link.name);
    let given = &link.inertial;
    let mass_kg = finite(given.mass.value, "mass", owner)?;
    let (rotation, center_m) = pose(&given.origin, owner)?;
    let i = &given.inertia;
    for (value, field) in [
        (i.ixx, "inertia ixx"),
        (i.ixy, "inertia ixy"),
        (i.ixz, "inertia ixz"),
        (i.iyy, "inertia iyy"),
        (i.iyz, "inertia iyz"),
        (i.izz, "inertia izz"),
    ] {
        finite(value, field, owner)?;
    }
    let rotational = Matrix3::new(i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz);
    if mass_kg == 0.0 && rotational == Matrix3::zeros() {
        return Ok(Inertia::zero());
    }
    if mass_kg <= 0.0 {
        return Err(ModelError::BadMass { link: link.name.clone(), mass_kg });
    }
    let (moments, slack) = principal_moments(&rotational);
    if moments[0] < -slack {
        return Err(ModelError::BadInertia { link: link.name.clone(), moments });
    }
    Ok(Inertia { mass_kg, center_m, rotational_kg_m2: rotation * rotational * rotation.transpose() })
}

/// Principal moments, ascending, and how far rounding in a file may take them from what is possible: a flat or rod-like
/// body meets the triangle inequality with equality.
fn principal_moments(rotational: &Matrix3<f64>) -> ([f64; 3], f64) {
    let mut moments: [f64; 3] = rotational.symmetric_eigenvalues().into();
    moments.sort_by(f64::total_cmp);
    (moments, 1e-6 * moments[2].abs())
}
