//! Undisturbed walking, and going where it is commanded.

use super::cases::{Bench, velocity};
use control::Velocity;
use gait::Gait;
use tandem_sim_bridge::trial::{Outcome, Sample, Trial};

pub fn undisturbed(bench: &Bench) {
    for name in bench.all_gaits().into_iter().chain(["wide".to_owned()]) {
        let gait = bench.gait(&name);
        let mut trial = Trial::default();
        trial.simulator.seed = 1;
        let outcome = bench.run(&gait, trial);
        let f = &outcome.figures;
        let torque = f.mean_abs_torque_nm;
        let end = outcome.ended.as_ref().map_or("up".to_owned(), |(at_s, why)| format!("{why} after {at_s:.1} s"));
        println!(
            "undisturbed_{name} = {end}, torque {:.2} {:.2} {:.2} N m, roll {:.2} pitch {:.2} deg rms, {:.3} m/s, sideways {:.2} m, turned {:.1} deg, {:.0} W",
            torque.hip_roll,
            torque.hip_pitch,
            torque.knee,
            outcome.sway_deg[0],
            outcome.sway_deg[1],
            f.speed_m_s,
            f.drift_m[1],
            f.turned_deg,
            outcome.power_w
        );
    }
}

/// Mean velocities between two times, and the turning by the change of yaw.
pub fn mean(samples: &[Sample], from_s: f64, to_s: f64) -> Option<[f64; 3]> {
    let within: Vec<&Sample> = samples.iter().filter(|s| (from_s..to_s).contains(&s.time_s)).collect();
    let (first, last) = (within.first()?, within.last()?);
    let n = within.len() as f64;
    let of = |axis: usize| within.iter().map(|s| s.velocity[axis]).sum::<f64>() / n;
    let turning = (last.turned_rad[2] - first.turned_rad[2]) / (last.time_s - first.time_s);
    (within.len() > 50).then_some([of(0), of(1), turning])
}

/// What is asked for, each from its time on: seconds; ahead and to the left, m/s, and turning, rad/s.
pub const FROM: [(f64, [f64; 3]); 10] = [
    (0.0, [0.0, 0.0, 0.0]),
    (3.0, [0.3, 0.0, 0.0]),
    (7.0, [0.0, 0.0, 0.0]),
    (10.0, [-0.2, 0.0, 0.0]),
    (14.0, [0.0, 0.15, 0.0]),
    (18.0, [0.0, -0.15, 0.0]),
    (22.0, [0.0, 0.0, 0.4]),
    (26.0, [0.0, 0.0, -0.4]),
    (30.0, [0.3, 0.1, 0.3]),
    (35.0, [0.0, 0.0, 0.0]),
];

/// How far a gait is off what is asked for, a command after the other, once it has settled; and how a trial ended that
/// did not survive.
pub fn errors(
    bench: &Bench,
    gait: &Gait,
    from: &[(f64, [f64; 3])],
    seeds: u64,
) -> (Vec<[f64; 3]>, Option<(f64, String)>) {
    const SETTLED_S: f64 = 1.2;
    let seconds = 39.0;
    let (mut errors, mut ended) = (Vec::new(), None);
    for seed in 0..seeds {
        let asked = from.iter().map(|(t, [x, y, w])| (*t, velocity(*x, *y, *w))).collect();
        let mut trial = Trial { seconds, asked, ..Trial::default() };
        trial.simulator.seed = seed;
        let outcome = bench.run(gait, trial);
        for (n, (from_s, asked)) in from.iter().enumerate() {
            let to_s = from.get(n + 1).map_or(seconds, |next| next.0);
            if let Some(got) = mean(&outcome.samples, from_s + SETTLED_S, to_s) {
                errors.push([0, 1, 2].map(|axis: usize| (got[axis] - asked[axis]).abs()));
            }
        }
        ended = ended.or(outcome.ended);
    }
    (errors, ended)
}

pub fn driving(bench: &Bench) {
    for name in ["amble/step", "amble", "gait1", "wide"] {
        let (errors, ended) = errors(bench, &bench.gait(name), &FROM, 2);
        if let Some((at_s, why)) = ended {
            println!("driving_{name} = {why} after {at_s:.1} s");
        }
        let average = |axis: usize| errors.iter().map(|e| e[axis]).sum::<f64>() / errors.len() as f64;
        let most = |axis: usize| errors.iter().map(|e| e[axis]).fold(0.0, f64::max);
        println!(
            "driving_{name} = mean error {:.3} {:.3} m/s {:.3} rad/s, largest {:.3} {:.3} m/s {:.3} rad/s",
            average(0),
            average(1),
            average(2),
            most(0),
            most(1),
            most(2)
        );
    }
}

/// Where a robot that does exactly as it is commanded ends: the command slewed, integrated from rest.
fn ideal(asked: &[(f64, Velocity)], seconds: f64) -> [f64; 2] {
    const STEP_S: f64 = 1e-3;
    let (mut v, mut at, mut yaw) = ([0.0_f64; 3], [0.0; 2], 0.0_f64);
    for n in 0..(seconds / STEP_S) as u64 {
        let t = n as f64 * STEP_S;
        let wanted = asked.iter().take_while(|(from_s, _)| *from_s <= t).last().map(|(_, v)| *v).unwrap_or_default();
        for (axis, (wanted, rate)) in
            [(wanted.forward_m_s, 0.6), (wanted.left_m_s, 0.6), (wanted.yaw_rad_s, 1.0)].into_iter().enumerate()
        {
            v[axis] += (wanted - v[axis]).clamp(-rate * STEP_S, rate * STEP_S);
        }
        yaw += v[2] * STEP_S;
        let (sine, cosine) = yaw.sin_cos();
        at[0] += (cosine * v[0] - sine * v[1]) * STEP_S;
        at[1] += (sine * v[0] + cosine * v[1]) * STEP_S;
    }
    at
}

/// A figure of eight of 12.6 m, odometry alone, from where the robot has come to rest: the trial puts it there as the
/// gait walks, and it goes on for 0.3 m.
pub fn eight(bench: &Bench) {
    const BEGIN_S: f64 = 3.0;
    let turn_s = std::f64::consts::TAU / 0.35;
    let asked = vec![
        (0.0, velocity(0.0, 0.0, 0.0)),
        (BEGIN_S, velocity(0.35, 0.0, 0.35)),
        (BEGIN_S + turn_s, velocity(0.35, 0.0, -0.35)),
        (BEGIN_S + 2.0 * turn_s, velocity(0.0, 0.0, 0.0)),
    ];
    let seconds = BEGIN_S + 39.0;
    let [x, y] = ideal(&asked, seconds);
    for name in ["amble/step", "amble", "gait1", "wide"] {
        let gait = bench.gait(name);
        for seed in 0..2 {
            let mut trial = Trial { seconds, asked: asked.clone(), ..Trial::default() };
            trial.simulator.seed = seed;
            let outcome: Outcome = bench.run(&gait, trial);
            let eight: Vec<&Sample> = outcome.samples.iter().filter(|sample| sample.time_s >= BEGIN_S).collect();
            let (Some(first), Some(last)) = (eight.first(), eight.last()) else { continue };
            let [px, py] = [0, 1].map(|axis: usize| last.position_m[axis] - first.position_m[axis]);
            let (sine, cosine) = first.turned_rad[2].sin_cos();
            let [ideal_x, ideal_y] = [cosine * x - sine * y, sine * x + cosine * y];
            let [ox, oy] = [0, 1].map(|axis: usize| last.odometry_m[axis] - first.odometry_m[axis]);
            let walked: f64 = eight
                .windows(2)
                .map(|w| (w[1].position_m[0] - w[0].position_m[0]).hypot(w[1].position_m[1] - w[0].position_m[1]))
                .sum();
            println!(
                "eight_{name}_{seed} = end error {:.2} m, odometry {:.2} m of {walked:.1} m{}",
                (px - ideal_x).hypot(py - ideal_y),
                (px - ox).hypot(py - oy),
                outcome.ended.map_or(String::new(), |(at_s, why)| format!(", {why} after {at_s:.1} s"))
            );
        }
    }
}
