//! The model: a tree of joints, and what is cut from it.

use nalgebra::Vector3;

use crate::error::ModelError;
use crate::inertia::Inertia;
use crate::joint::{BASE_JOINTS, Frame, FrameId, Joint, JointKind};
use crate::limbs::Limbs;

/// A robot as a tree of one-degree-of-freedom joints: everything about it that does not change.
#[derive(Debug, Clone)]
pub struct Model {
    /// Acceleration of free fall in world axes, m/s²; tilt it to stand on a slope.
    pub gravity: Vector3<f64>,
    /// Parents before children.
    pub(crate) joints: Vec<Joint>,
    pub(crate) frames: Vec<Frame>,
    /// Per coordinate, the place in `joints`.
    pub(crate) joint_of_dof: Vec<usize>,
    joint_names: Vec<String>,
    /// How many joints from the root on only carry the rest along a line (a floating base: 3).
    pub(crate) carriers: usize,
    /// The body that a floating base moves.
    pub(crate) torso: Option<usize>,
    /// Torso and legs, if that is what the robot consists of: then the fast algorithms run.
    pub(crate) limbs: Option<Limbs>,
    /// See [`Model::notes`].
    pub(crate) notes: Vec<String>,
}

impl Model {
    /// Joints must come parents first, with their coordinates a permutation of 0..n.
    pub(crate) fn assemble(joints: Vec<Joint>, frames: Vec<Frame>, torso: Option<usize>) -> Self {
        let mut joint_of_dof = vec![0; joints.len()];
        for (i, joint) in joints.iter().enumerate() {
            joint_of_dof[joint.dof] = i;
            debug_assert!(joint.parent.is_none_or(|parent| parent < i));
        }
        let children = |parent: Option<usize>| joints.iter().filter(|j| j.parent == parent).count();
        let mut carriers = 0;
        while carriers < joints.len() {
            let parent = carriers.checked_sub(1);
            let only_child = joints[carriers].parent == parent && children(parent) == 1;
            if joints[carriers].kind == JointKind::Prismatic && only_child {
                carriers += 1;
            } else {
                break;
            }
        }
        let joint_names = joint_of_dof.iter().map(|&i| joints[i].name.clone()).collect();
        let limbs = Limbs::find(&joints, torso);
        Self {
            gravity: Vector3::new(0.0, 0.0, -9.81),
            limbs,
            joints,
            frames,
            joint_of_dof,
            joint_names,
            carriers,
            torso,
            notes: Vec::new(),
        }
    }

    /// What is not as the URDF says, a line each, for a person to read.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Moves a frame's origin by `offset_m` in its own axes: from a link's origin to the centre of its shape, for
    /// example.
    pub fn move_frame(&mut self, frame: FrameId, offset_m: &Vector3<f64>) {
        let frame = &mut self.frames[frame.0];
        frame.translation += frame.rotation * offset_m;
    }

    /// Number of coordinates.
    pub fn dof(&self) -> usize {
        self.joints.len()
    }

    /// Names of the joints in the order of their coordinates.
    pub fn joint_names(&self) -> &[String] {
        &self.joint_names
    }

    /// The coordinate of a joint.
    pub fn joint_index(&self, name: &str) -> Option<usize> {
        // From the end: a robot's own joint may bear the name of one of the base's.
        self.joint_names.iter().rposition(|known| known == name)
    }

    /// How the joint of coordinate `dof` moves.
    pub fn joint_kind(&self, dof: usize) -> JointKind {
        self.joints[self.joint_of_dof[dof]].kind
    }

    /// The coordinate of the joint that the joint of coordinate `dof` hangs from; none for the world.
    pub fn parent_dof(&self, dof: usize) -> Option<usize> {
        self.joints[self.joint_of_dof[dof]].parent.map(|parent| self.joints[parent].dof)
    }

    /// Mass properties of the body moved by the joint of coordinate `dof` with all that is fixed to
    /// it, in the frame of its URDF link.
    pub fn body_inertia(&self, dof: usize) -> &Inertia {
        &self.joints[self.joint_of_dof[dof]].inertia
    }

    /// The URDF link that the joint of coordinate `dof` moves.
    pub fn link_name(&self, dof: usize) -> &str {
        &self.joints[self.joint_of_dof[dof]].link
    }

    /// Mass of all bodies, kg.
    pub fn total_mass(&self) -> f64 {
        self.joints.iter().map(|joint| joint.inertia.mass_kg).sum()
    }

    /// The frame of a link, if the link is part of this model.
    pub fn frame_id(&self, link: &str) -> Option<FrameId> {
        self.frames.iter().position(|frame| frame.name == link && frame.body.is_some()).map(FrameId)
    }

    /// The link of a frame.
    pub fn frame_name(&self, frame: FrameId) -> &str {
        &self.frames[frame.0].name
    }

    /// The coordinate of the joint whose body carries the frame; none if the frame is not part of
    /// this model.
    pub fn frame_dof(&self, frame: FrameId) -> Option<usize> {
        self.frames[frame.0].body.map(|body| self.joints[body].dof)
    }

    /// The floating-base model that keeps only the named joints, their coordinates in the order of
    /// the names, with the torso's mass and inertia times `torso_share` (from 0 to 1). Bodies moved by
    /// joints that are not named are removed.
    ///
    /// With two legs named it is one of the paper's bipeds (section II-B); with all of them and a
    /// share of 1 it is the whole robot in another order of coordinates.
    ///
    /// # Errors
    ///
    /// If a name is unknown, a kept joint hangs from one that is not kept, or the share is not a
    /// fraction.
    pub fn subtree<S: AsRef<str>>(&self, joints: &[S], torso_share: f64) -> Result<Model, ModelError> {
        if !(0.0..=1.0).contains(&torso_share) {
            return Err(ModelError::BadTorsoShare(torso_share));
        }
        let base = if self.torso.is_some() { BASE_JOINTS.len() } else { 0 };
        // New coordinate of each joint kept.
        let mut dof_of_joint: Vec<Option<usize>> = vec![None; self.joints.len()];
        for dof in 0..base {
            dof_of_joint[self.joint_of_dof[dof]] = Some(dof);
        }
        for (k, name) in joints.iter().enumerate() {
            let name = name.as_ref();
            let Some(dof) = self.joint_index(name).filter(|&dof| dof >= base) else {
                return Err(ModelError::UnknownJoint {
                    joint: name.to_owned(),
                    known: self.joint_names[base..].join(", "),
                });
            };
            let place = &mut dof_of_joint[self.joint_of_dof[dof]];
            if place.replace(base + k).is_some() {
                return Err(ModelError::Duplicate { kind: "joint", name: name.to_owned() });
            }
        }
        let mut new_place = vec![None; self.joints.len()];
        let mut kept = Vec::with_capacity(base + joints.len());
        for (i, joint) in self.joints.iter().enumerate() {
            let Some(dof) = dof_of_joint[i] else { continue };
            let parent = match joint.parent {
                None => None,
                Some(parent) => Some(new_place[parent].ok_or_else(|| ModelError::MissingParent {
                    joint: joint.name.clone(),
                    parent: self.joints[parent].name.clone(),
                })?),
            };
            new_place[i] = Some(kept.len());
            let mut joint = Joint { parent, dof, ..joint.clone() };
            if self.torso == Some(i) {
                joint.inertia = joint.inertia.scaled(torso_share);
            }
            kept.push(joint);
        }
        let frames = self
            .frames
            .iter()
            .map(|frame| Frame { body: frame.body.and_then(|b| new_place[b]), ..frame.clone() })
            .collect();
        let mut model = Self::assemble(kept, frames, self.torso.and_then(|torso| new_place[torso]));
        model.gravity = self.gravity;
        Ok(model)
    }

    /// The same model computed by the algorithms for any tree, which are slower where the robot is a
    /// torso with legs. For tests of one against the other.
    #[doc(hidden)]
    #[must_use]
    pub fn as_general_tree(mut self) -> Self {
        self.limbs = None;
        self
    }

    /// The body of a frame.
    ///
    /// # Panics
    ///
    /// If the frame is not part of this model, for example a toe of a leg that was cut off.
    pub(crate) fn body_of(&self, frame: FrameId) -> (usize, &Frame) {
        let found = self.frames.get(frame.0).expect("the frame id comes from another robot's model");
        match found.body {
            Some(body) => (body, found),
            None => panic!("frame '{}' is not part of this model", found.name),
        }
    }
}
