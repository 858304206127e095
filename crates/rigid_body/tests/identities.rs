//! Identities that hold between the algorithms, to rounding.

mod common;

use common::{Random, difference, random_state, relative_error, vision60};
use nalgebra::{DMatrix, DVector, Vector3};
use rigid_body::{
    Data, aba, bias_forces, center_of_mass, crba, kinetic_energy, point_kinematics, potential_energy, rnea,
    rnea_derivatives,
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

/// dM/dt along v: column k is the change of M e_k, which is that of the inverse dynamics of e_k from rest.
fn mass_rate(model: &rigid_body::Model, data: &mut Data, q: &[f64], v: &DVector<f64>) -> DMatrix<f64> {
    let n = model.dof();
    let zero = vec![0.0; n];
    rnea_derivatives(model, data, q, &zero, &zero, &[]);
    let gravity = data.dtau_dq.clone();
    let mut rate = DMatrix::zeros(n, n);
    for k in 0..n {
        let mut unit = zero.clone();
        unit[k] = 1.0;
        rnea_derivatives(model, data, q, &zero, &unit, &[]);
        rate.set_column(k, &((&data.dtau_dq - &gravity) * v));
    }
    rate
}

#[test]
fn the_mass_matrix_changes_as_the_coriolis_matrix_says() {
    let (model, mut random) = (vision60(), Random(6));
    let mut data = Data::new(&model);
    for _ in 0..20 {
        let s = random_state(&model, &mut random);
        let v = DVector::from_column_slice(&s.v);
        let rate = mass_rate(&model, &mut data, &s.q, &v);
        // The Coriolis terms are quadratic in v, so with Christoffel's C they are C v and ∂(C v)/∂v = 2 C.
        rnea_derivatives(&model, &mut data, &s.q, &s.v, &[0.0; 18], &[]);
        let skew = &rate - &data.dtau_dv;
        assert!(relative_error(&skew, &(-skew.transpose())) < 1e-12, "dM/dt − 2 C is not skew");
        assert!(relative_error(&skew, &DMatrix::zeros(18, 18)) > 1e-3, "the test compares zeros");
    }
}

#[test]
fn the_torques_power_is_the_energys_rate() {
    let (model, mut random) = (vision60(), Random(7));
    let mut data = Data::new(&model);
    for _ in 0..20 {
        let s = random_state(&model, &mut random);
        let (v, a) = (DVector::from_column_slice(&s.v), DVector::from_column_slice(&s.a));
        let power = rnea(&model, &mut data, &s.q, &s.v, &s.a, &[]).dot(&v);
        let mass = crba(&model, &mut data, &s.q).clone();
        let kinetic = v.dot(&(mass * &a)) + 0.5 * v.dot(&(mass_rate(&model, &mut data, &s.q, &v) * &v));
        let center = center_of_mass(&model, &mut data, &s.q, &s.v);
        let potential = -model.total_mass() * model.gravity.dot(&center.velocity);
        let scale = power.abs().max(kinetic.abs()).max(1.0);
        assert!((power - kinetic - potential).abs() < 1e-12 * scale, "{power} W, {kinetic} W and {potential} W");
    }
}

#[test]
fn a_position_far_away_costs_no_precision() {
    let (model, mut random) = (vision60(), Random(8));
    let (mut data, mut other) = (Data::new(&model), Data::new(&model));
    let mut s = random_state(&model, &mut random);
    rnea_derivatives(&model, &mut data, &s.q, &s.v, &s.a, &s.forces);
    s.q[0] += 1e6;
    s.v[1] += 1e3;
    rnea_derivatives(&model, &mut other, &s.q, &s.v, &s.a, &s.forces);
    assert_eq!(data.tau, other.tau);
    assert_eq!(data.dtau_dq, other.dtau_dq);
    assert_eq!(data.dtau_dv, other.dtau_dv);
}
