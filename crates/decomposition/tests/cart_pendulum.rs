//! The paper's example (section II-B): a cart of mass 2M with two pendulums, as two half carts.

use nalgebra::DVector;
use rigid_body::{Data, Model, aba, bias_forces, crba, rnea};

const CART_KG: f64 = 1.7; // M, half of the cart
const BOB_KG: f64 = 0.6; // m
const LENGTH_M: f64 = 0.8; // l
const SPIN: f64 = 0.004; // rotational inertia of the bob: the paper's is a point

/// A cart on a rail along x with pendulums that stand up at θ = 0 and lean to −x for θ > 0.
fn cart(mass_kg: f64, pendulums: &[&str]) -> Model {
    let inertia = |i: f64| format!("<inertia ixx=\"{i}\" ixy=\"0\" ixz=\"0\" iyy=\"{i}\" iyz=\"0\" izz=\"{i}\"/>");
    let mut urdf = format!(
        "<robot name=\"cart\"><link name=\"rail\"/><link name=\"cart\"><inertial>\
         <mass value=\"{mass_kg}\"/>{}</inertial></link>\
         <joint name=\"x\" type=\"prismatic\"><parent link=\"rail\"/><child link=\"cart\"/>\
         <axis xyz=\"1 0 0\"/><limit effort=\"1\" velocity=\"1\"/></joint>",
        inertia(1.0)
    );
    for name in pendulums {
        urdf += &format!(
            "<link name=\"{name}\"><inertial><origin xyz=\"0 0 {LENGTH_M}\"/>\
             <mass value=\"{BOB_KG}\"/>{}</inertial></link>\
             <joint name=\"theta_{name}\" type=\"continuous\"><parent link=\"cart\"/>\
             <child link=\"{name}\"/><axis xyz=\"0 -1 0\"/></joint>",
            inertia(SPIN)
        );
    }
    Model::fixed_base_from_urdf(&(urdf + "</robot>")).expect("a cart")
}

const STATES: [(f64, f64, f64); 3] = [(0.3, 2.1, -4.0), (-1.2, 2.5, 7.0), (2.0, -3.0, 0.5)];

#[test]
fn half_a_cart_is_the_closed_form() {
    let half = cart(CART_KG, &["f"]);
    let mut data = Data::new(&half);
    for (theta, rate, _) in STATES {
        let (sine, cosine) = theta.sin_cos();
        let mass = crba(&half, &mut data, &[0.7, theta]).clone();
        let coupling = -BOB_KG * LENGTH_M * cosine;
        let expected = [CART_KG + BOB_KG, coupling, coupling, BOB_KG * LENGTH_M * LENGTH_M + SPIN];
        for (found, expected) in mass.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-14);
        }
        let bias = bias_forces(&half, &mut data, &[0.7, theta], &[0.2, rate]).clone();
        let gravity = -BOB_KG * 9.81 * LENGTH_M * sine;
        let centripetal = BOB_KG * LENGTH_M * rate * rate * sine;
        assert!((bias[0] - centripetal).abs() < 1e-13);
        assert!((bias[1] - gravity).abs() < 1e-13);
        // The paper prints θ̇ where θ̇² belongs.
        assert!((bias[0] - BOB_KG * LENGTH_M * rate * sine).abs() > 0.05);
    }
}

#[test]
fn two_halves_with_the_connection_force_are_the_whole_cart() {
    let (half, whole) = (cart(CART_KG, &["f"]), cart(2.0 * CART_KG, &["f", "r"]));
    let (mut half_data, mut data) = (Data::new(&half), Data::new(&whole));
    let (q, v, u) = ([0.1, 0.4, -0.9], [0.5, 2.0, 1.0], [0.0, 3.0, -1.5]);
    let a = aba(&whole, &mut data, &q, &v, &u, &[]).clone();
    // (f) has −λc on the cart, (r) has +λc; the torques are those of the whole.
    let f = rnea(&half, &mut half_data, &[q[0], q[1]], &[v[0], v[1]], &[a[0], a[1]], &[]).clone();
    let r = rnea(&half, &mut half_data, &[q[0], q[2]], &[v[0], v[2]], &[a[0], a[2]], &[]).clone();
    assert!((f[0] + r[0]).abs() < 1e-12, "−λc and +λc");
    assert!((f[1] - u[1]).abs() < 1e-12 && (r[1] - u[2]).abs() < 1e-12);
    assert!(f[0].abs() > 0.1, "the connection carries something");
}

#[test]
fn pendulums_in_symmetry_leave_the_cart_alone() {
    let whole = cart(2.0 * CART_KG, &["f", "r"]);
    let half = cart(CART_KG, &["f"]);
    let (mut data, mut half_data) = (Data::new(&whole), Data::new(&half));
    for (theta, rate, torque) in STATES {
        let (q, v) = ([0.0, theta, -theta], [0.0, rate, -rate]);
        let a: DVector<f64> = aba(&whole, &mut data, &q, &v, &[0.0, torque, -torque], &[]).clone();
        assert!(a[0].abs() < 1e-13, "the cart's acceleration");
        let front = rnea(&half, &mut half_data, &[0.0, theta], &[0.0, rate], &[0.0, a[1]], &[]).clone();
        let connection = -front[0];
        let (sine, cosine) = theta.sin_cos();
        let arm = BOB_KG * LENGTH_M;
        let expected = arm * cosine * a[1] - arm * rate * rate * sine;
        assert!((connection - expected).abs() < 1e-12, "{connection} N, expected {expected} N");
        // As printed: the opposite sign, and θ̇ instead of θ̇².
        let printed = -arm * cosine * a[1] + arm * rate * sine;
        assert!((connection - printed).abs() > 0.1);
    }
}
