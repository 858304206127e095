//! The algorithms for a floating torso with two or four legs of three revolute joints.
//!
//! The recursions are those of the general tree (see [`crate::dynamics`], [`crate::derivatives`],
//! [`crate::forward`]; the tests hold the two against each other), with three things taken from the
//! structure:
//!
//! - all legs are computed at once, one to a lane of a vector register;
//! - body axes are turned so that every joint turns about its z axis;
//! - the reference moves with the torso (the laws of motion do not mind), so the torso's linear
//!   velocity is zero and the three sliding joints drop out.

use wide::{f64x2, f64x4};

use crate::joint::{Joint, JointKind};

mod derivatives;
mod export;
mod forward_dynamics;
mod inverse_dynamics;
mod links;
mod pass;
mod points;

use links::LimbModel;
use pass::LimbData;

/// Place of the torso among the joints: below the six that carry it.
pub(crate) const TORSO: usize = 5;

/// The structure, where a model has it.
#[derive(Debug, Clone)]
pub(crate) enum Limbs {
    Two(Box<LimbModel<f64x2>>),
    Four(Box<LimbModel<f64x4>>),
}

impl Limbs {
    /// The torso and legs of a floating-base model, if that is what it consists of.
    pub fn find(joints: &[Joint], torso: Option<usize>) -> Option<Self> {
        let torso = torso.filter(|&torso| torso == TORSO)?;
        let children =
            |of: usize| -> Vec<usize> { (0..joints.len()).filter(|&i| joints[i].parent == Some(of)).collect() };
        let mut legs = Vec::new();
        for hip in children(torso) {
            let [pitch] = children(hip)[..] else { return None };
            let [knee] = children(pitch)[..] else { return None };
            if !children(knee).is_empty() {
                return None;
            }
            legs.push([hip, pitch, knee]);
        }
        if joints[6..].iter().any(|joint| joint.kind != JointKind::Revolute) {
            return None;
        }
        match legs.len() {
            2 => Some(Self::Two(Box::new(LimbModel::new(joints, torso, &legs)))),
            4 => Some(Self::Four(Box::new(LimbModel::new(joints, torso, &legs)))),
            _ => None,
        }
    }
}

/// The workspace that belongs to [`Limbs`].
#[derive(Debug, Clone)]
pub(crate) enum LimbWork {
    Two(Box<LimbData<f64x2>>),
    Four(Box<LimbData<f64x4>>),
}

impl LimbWork {
    pub fn new(limbs: &Limbs) -> Self {
        match limbs {
            Limbs::Two(_) => Self::Two(Box::new(LimbData::new())),
            Limbs::Four(_) => Self::Four(Box::new(LimbData::new())),
        }
    }
}

/// Runs `$body` with `$m` and `$d` bound to the model's and workspace's halves of one width.
macro_rules! with_limbs {
    ($limbs:expr, $work:expr, |$m:ident, $d:ident| $body:expr) => {
        match ($limbs, $work) {
            ($crate::limbs::Limbs::Two($m), $crate::limbs::LimbWork::Two($d)) => $body,
            ($crate::limbs::Limbs::Four($m), $crate::limbs::LimbWork::Four($d)) => $body,
            _ => panic!("this Data was made for another model"),
        }
    };
}
pub(crate) use with_limbs;
