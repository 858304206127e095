//! Gaits whose cycle is other than the trot's two steps.

use gait::{Coefficients, Domain, Gait, JOINTS};

fn trot() -> Gait {
    Gait::from_json(include_str!("../../../tests/gaits/amble.json")).unwrap()
}

/// The trot's two steps as a cycle of domains.
fn with_cycle() -> Gait {
    let trot = trot();
    Gait { cycle: trot.schedule(), ..trot }
}

#[test]
fn a_cycle_makes_version_3_comes_back_and_is_what_is_walked() {
    let trot = trot();
    assert!(!trot.to_json().contains("\"cycle\""), "a gait without one is written as before");
    for lead in [Vec::new(), trot.schedule()] {
        let gait = Gait { lead, ..with_cycle() };
        let text = gait.to_json();
        assert!(text.contains("\"version\": 3,"), "{text}");
        let again = Gait::from_json(&text).unwrap();
        assert_eq!(again, gait);
        assert_eq!(again.to_json(), text);
        assert_eq!(again.schedule(), gait.cycle);
        assert_eq!(again.stride_duration_s(), 2.0 * trot.step_duration_s);
    }
    let text = with_cycle().to_json().replace("\"version\": 3,", "\"version\": 1,");
    let e = Gait::from_json(&text).unwrap_err().to_string();
    assert!(e.contains("version is 1, expected 3: the file has no second_step, no lead and a cycle"), "{e}");
}

/// Adds to the first joint's polynomial at a domain's end: `by` rad, its velocity as it was; or the other way round.
fn bend(domain: &mut Domain, by_rad: f64, slope_rad: f64) {
    let row: &mut Coefficients = &mut domain.planned_rad[0];
    row[5] += by_rad;
    row[4] += by_rad - slope_rad;
}

#[test]
fn a_cycle_that_cannot_be_walked_is_refused_by_name() {
    type Case = (&'static str, fn(&mut Gait));
    let cases: [Case; 14] = [
        ("cycle has 9 domains, expected at most 8", |g| g.cycle = vec![g.cycle[0].clone(); 9]),
        ("cycle[1].duration_s is 0, expected 0.02 to 10 s", |g| g.cycle[1].duration_s = 0.0),
        ("cycle[1].coefficients_rad[6] is inf", |g| g.cycle[1].planned_rad[1][0] = f64::INFINITY),
        ("cycle[1].reference_coefficients_rad[0] is NaN", |g| g.cycle[1].reference_rad[0][0] = f64::NAN),
        ("cycle[1].stance_legs names 1, expected at least 2", |g| g.cycle[1].stands = [true, false, false, false]),
        ("cycle has front_left stand in every domain", |g| g.cycle[0].stands = [true; 4]),
        ("cycle has front_left swing in every domain", |g| {
            g.cycle.extend_from_within(..);
            let stance_legs = [[1, 2], [2, 3], [1, 3], [1, 2]];
            for (domain, legs) in g.cycle.iter_mut().zip(stance_legs) {
                domain.stands = std::array::from_fn(|leg| legs.contains(&leg));
            }
        }),
        ("coefficients_rad differ from cycle[0].coefficients_rad", |g| g.coefficients_rad[3][2] += 1e-9),
        ("reference_coefficients_rad differ from cycle[0]", |g| g.reference_coefficients_rad[3][2] += 1e-9),
        ("second_step is given beside a cycle", |g| {
            let (coefficients_rad, reference_coefficients_rad) = (g.coefficients_rad, g.reference_coefficients_rad);
            g.second_step = Some(gait::SecondStep { coefficients_rad, reference_coefficients_rad });
        }),
        ("cycle takes 1.8", |g| g.cycle[1].duration_s *= 0.8),
        ("cycle[0].coefficients_rad let front_left_hip_roll jump by 0.0", |g| {
            bend(&mut g.cycle[0], 0.03, 0.0);
            g.coefficients_rad = g.cycle[0].planned_rad;
        }),
        ("rad/s at the domain's end, expected at most", |g| bend(&mut g.cycle[1], 0.0, 0.5)),
        ("lead[0].coefficients_rad let", |g| {
            g.lead = vec![g.cycle[1].clone()];
            g.lead[0].planned_rad = [[0.0; 6]; JOINTS];
        }),
    ];
    for (expected, spoil) in cases {
        let mut gait = with_cycle();
        spoil(&mut gait);
        let e = gait.validate().unwrap_err().to_string();
        assert!(e.contains(expected), "expected {expected:?} in {e:?}");
    }
    with_cycle().validate().unwrap();
}
