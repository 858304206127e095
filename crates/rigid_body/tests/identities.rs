//! Identities that hold between the algorithms, to rounding.

mod common;

use common::{Random, difference, random_state, relative_error, vision60};
use nalgebra::{DVector, Vector3};
use rigid_body::{
    Data, aba, bias_forces, center_of_mass, crba, kinetic_energy, point_kinematics, potential_energy, rnea,
};

#[test]
fn inverse_dynamics_is_mass_matrix_times_acceleration_plus_bias() {
    let (model, mut random) = (vision60(), Random(3));
    let mut data = Data::new(&model);
    for _ in 0..100 {
        let s = random_state(&model, &mut random);
        let mass = crba(&model, &mut data, &s.q).clone();
        let bias = bias_forces(&model, &mut data, &s.q, &s.v).clone();
        let mut expected = mass * DVector::from_column_slice(&s.a) + bias;
        for (toe, force) in &s.forces {
            let point = point_kinematics(&model, &mut data, &s.q, &s.v, &s.a, *toe);
            expected -= point.jacobian.tr_mul(force);
        }
        let tau = rnea(&model, &mut data, &s.q, &s.v, &s.a, &s.forces);
        assert!(relative_error(tau, &expected) < 1e-12);
    }
}

#[test]
fn forward_dynamics_undoes_inverse_dynamics() {
    let (model, mut random) = (vision60(), Random(4));
    let mut data = Data::new(&model);
    for _ in 0..100 {
        let s = random_state(&model, &mut random);
        let tau = rnea(&model, &mut data, &s.q, &s.v, &s.a, &s.forces).clone();
        let a = aba(&model, &mut data, &s.q, &s.v, tau.as_slice(), &s.forces);
        assert!(relative_error(a, &s.a) < 1e-11, "{}", relative_error(a, &s.a));
    }
}

#[test]
fn energies_give_the_mass_matrix_and_gravity() {
    let (mut model, mut random) = (vision60(), Random(5));
    model.gravity = Vector3::new(0.3, -1.0, -9.0);
    let mut data = Data::new(&model);
    for _ in 0..20 {
        let s = random_state(&model, &mut random);
        let v = DVector::from_column_slice(&s.v);
        let mass = crba(&model, &mut data, &s.q).clone();
        let kinetic = kinetic_energy(&model, &mut data, &s.q, &s.v);
        let expected = 0.5 * v.dot(&(mass * &v));
        assert!((kinetic - expected).abs() < 1e-12 * expected);
        let zero = vec![0.0; model.dof()];
        let gravity = bias_forces(&model, &mut data, &s.q, &zero).clone();
        let slope = difference(&s.q, |q| vec![potential_energy(&model, &mut data, q)]);
        assert!(relative_error(&gravity, &slope) < 1e-9);
        let center = center_of_mass(&model, &mut data, &s.q, &s.v);
        let potential = potential_energy(&model, &mut data, &s.q);
        let expected = -model.total_mass() * model.gravity.dot(&center.position);
        assert!((potential - expected).abs() < 1e-11 * expected.abs().max(1.0));
        let moved = difference(&s.q, |q| center_of_mass(&model, &mut data, q, &s.v).position.as_slice().to_vec());
        assert!(relative_error(&center.velocity, &(moved * &v)) < 1e-9);
    }
}
