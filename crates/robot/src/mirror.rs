//! Checks that the two sides of the robot are mirror images.

use joints::mirrored_vector;
use nalgebra::{Matrix3, Vector3};
use rigid_body::{Data, Model, crba, forward_kinematics, frame_position, frame_rotation};

use crate::{Robot, RobotError};

/// Postures to compare at: joint angles with nothing special about them.
const POSTURES: [[f64; 12]; 3] = [
    [0.0; 12],
    [0.31, 0.62, 1.13, -0.24, 0.97, 0.81, 0.17, -0.53, 1.71, -0.38, 1.29, 0.47],
    [-0.43, 1.37, 2.11, 0.29, -0.71, 1.93, -0.11, 0.83, -0.67, 0.37, 0.23, 1.51],
];

/// What a body looks like from the torso.
struct Look {
    mass: f64,
    center: Vector3<f64>,
    inertia: Matrix3<f64>,
}

fn look(model: &Model, data: &Data, dof: usize) -> Look {
    let frame = model.frame_id(model.link_name(dof)).expect("a body's own link is a frame");
    let rotation = frame_rotation(model, data, frame);
    let body = model.body_inertia(dof);
    Look {
        mass: body.mass_kg,
        center: frame_position(model, data, frame) + rotation * body.center_m,
        inertia: rotation * body.rotational_kg_m2 * rotation.transpose(),
    }
}

/// Compares, link by link, the robot in some postures with the mirror image of the robot in the
/// mirrored postures: masses, centres of mass, inertias, toes. Then the mass matrices, which also
/// know the joints' axes.
pub(crate) fn check(robot: &Robot, tolerance: f64) -> Result<(), RobotError> {
    for posture in POSTURES {
        check_links(robot, posture, tolerance)?;
    }
    for posture in POSTURES {
        check_mass_matrix(robot, posture, tolerance)?;
    }
    Ok(())
}

fn coordinates(posture: [f64; 12]) -> [f64; 18] {
    let mut q = [0.0; 18];
    q[6..].copy_from_slice(&posture);
    q
}

fn check_links(robot: &Robot, posture: [f64; 12], tolerance: f64) -> Result<(), RobotError> {
    let model = &robot.model;
    let (mut here, mut there) = (Data::new(model), Data::new(model));
    let (q, zero) = (coordinates(posture), [0.0; 18]);
    forward_kinematics(model, &mut here, &q, &zero, &zero);
    forward_kinematics(model, &mut there, &robot.mirror.coordinates(&q), &zero, &zero);
    let flip = Matrix3::from_diagonal(&Vector3::from(mirrored_vector([1.0; 3])));
    let fail = |what, link: &str, image: &str, found: String, expected: String| {
        let (link, image) = (link.to_owned(), image.to_owned());
        Err(RobotError::Mirror { what, link, image, found, expected, tolerance })
    };
    let size = (0..4).map(|i| frame_position(model, &here, robot.legs[i].toe).norm()).fold(0.1, f64::max);
    // The torso's body is moved by roll, coordinate 3; the other five of the base move no mass.
    for dof in std::iter::once(3).chain(6..18) {
        let image = robot.mirror.coordinate_source(dof).0;
        let (a, b) = (look(model, &here, dof), look(model, &there, image));
        let (link, other) = (model.link_name(dof), model.link_name(image));
        if (a.mass - b.mass).abs() > tolerance * a.mass {
            return fail("mass (kg)", link, other, a.mass.to_string(), b.mass.to_string());
        }
        let center = flip * b.center;
        if (a.center - center).amax() > tolerance * size {
            return fail("centre of mass (m)", link, other, show(&a.center), show(&center));
        }
        let inertia = flip * b.inertia * flip;
        if (a.inertia - inertia).amax() > tolerance * a.inertia.amax() {
            let what = "inertia (kg m²; xx, xy, xz, yy, yz, zz)";
            return fail(what, link, other, show_inertia(&a.inertia), show_inertia(&inertia));
        }
    }
    for (i, leg) in robot.legs.iter().enumerate() {
        let image = &robot.legs[robot.mirror.leg[i]];
        let toe = frame_position(model, &here, leg.toe);
        let expected = flip * frame_position(model, &there, image.toe);
        if (toe - expected).amax() > tolerance * size {
            let (link, other) = (model.frame_name(leg.toe), model.frame_name(image.toe));
            return fail("position (m)", link, other, show(&toe), show(&expected));
        }
    }
    Ok(())
}

fn check_mass_matrix(robot: &Robot, posture: [f64; 12], tolerance: f64) -> Result<(), RobotError> {
    let (model, mirror) = (&robot.model, &robot.mirror);
    let mut data = Data::new(model);
    let q = coordinates(posture);
    let mass = crba(model, &mut data, &q).clone();
    let mirrored = crba(model, &mut data, &mirror.coordinates(&q)).clone();
    let scale = mass.amax();
    for row in 0..18 {
        for column in 0..18 {
            let ((image_row, row_sign), (image_column, column_sign)) =
                (mirror.coordinate_source(row), mirror.coordinate_source(column));
            let expected = row_sign * column_sign * mirrored[(image_row, image_column)];
            let found = mass[(row, column)];
            if (found - expected).abs() > tolerance * scale {
                // The joint lower in the tree is the one that moves otherwise than its image.
                let dof = row.max(column);
                return Err(RobotError::Mirror {
                    what: "mass matrix (an entry)",
                    link: model.link_name(dof).to_owned(),
                    image: model.link_name(mirror.coordinate_source(dof).0).to_owned(),
                    found: found.to_string(),
                    expected: expected.to_string(),
                    tolerance,
                });
            }
        }
    }
    Ok(())
}

fn show(v: &Vector3<f64>) -> String {
    format!("({}, {}, {})", v.x, v.y, v.z)
}

fn show_inertia(m: &Matrix3<f64>) -> String {
    format!("({}, {}, {}, {}, {}, {})", m[(0, 0)], m[(0, 1)], m[(0, 2)], m[(1, 1)], m[(1, 2)], m[(2, 2)])
}
