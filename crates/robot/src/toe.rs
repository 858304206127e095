//! The ball that a toe stands on.

use nalgebra::Vector3;
use rigid_body::{Description, FrameId, Model};
use urdf_rs::{Collision, Geometry, Link};

/// The toe's ball: the only ball among the shapes of its link that touch.
pub(crate) fn ball(link: &Link) -> Option<(&Collision, f64)> {
    let mut balls = link.collision.iter().filter_map(|shape| match shape.geometry {
        Geometry::Sphere { radius } if radius > 0.0 => Some((shape, radius)),
        _ => None,
    });
    balls.next().filter(|_| balls.next().is_none())
}

pub(crate) fn link<'a>(description: &'a Description, name: &str) -> Option<&'a Link> {
    description.robot().links.iter().find(|link| link.name == name)
}

/// Puts the toe's frame where the centre of its ball is.
pub(crate) fn centre_frame(model: &mut Model, description: &Description, toe: FrameId) {
    let name = model.frame_name(toe).to_owned();
    if let Some((ball, _)) = link(description, &name).and_then(ball) {
        model.move_frame(toe, &Vector3::from(ball.origin.xyz.0));
    }
}
