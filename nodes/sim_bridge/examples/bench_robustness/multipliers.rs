//! How fast a small disturbance grows or shrinks under either law, beside the certificate's multiplier.

use super::cases::{Bench, own_speed, velocity};
use gait::Gait;
use tandem_sim_bridge::simulator::Push;
use tandem_sim_bridge::trial::{Noise, Outcome, Sample, Trial};

/// A push so small that no step is hurried for it, and when it comes, s.
const IMPULSE_N_S: f64 = 2.0;
const LASTS_S: f64 = 0.01;
const PUSHED_S: f64 = 4.0;
/// Strides that are looked at.
const STRIDES: usize = 12;
/// Smaller differences are the sensors' resolution, larger ones no longer small, m.
const LEAST_M: f64 = 2e-4;
const MOST_M: f64 = 0.06;

/// The walk where a push of each sign differs from its twin, a stride after the other: in body tilt, as the hips' way,
/// and in velocity, as the way that it falls by. Where the robot is and where it heads is left out: to the bare law it
/// is nothing, to the balanced one slow loops'.
fn differences(bench: &Bench, gait: &Gait, balanced: bool, direction: [f64; 2]) -> Option<Vec<f64>> {
    let stride_s = 2.0 * gait.step_duration_s;
    let pushed = |sign: f64| -> Outcome {
        let force = direction.map(|share| sign * share * IMPULSE_N_S / LASTS_S);
        let push = Push { start_s: PUSHED_S, duration_s: LASTS_S, force_n: [force[0], force[1], 0.0] };
        // Sensors without noise: what is looked for is smaller.
        let noise = Noise { encoder_rad: 1e-9, ..Noise::default().times(0.0) };
        let asked = vec![(0.0, velocity(own_speed(gait), 0.0, 0.0))];
        let seconds = PUSHED_S + (STRIDES + 1) as f64 * stride_s;
        let mut trial = Trial { seconds, asked, noise, pushes: vec![push], ..Trial::default() };
        trial.simulator.joint_noise_rad = 0.0;
        bench.run_with(gait, balanced, trial)
    };
    let [one, other] = [pushed(1.0), pushed(-1.0)];
    if !(one.survived() && other.survived()) {
        return None;
    }
    let height_m = bench.robot.nominal.height_m;
    let lambda_s = (9.81 / height_m).sqrt();
    let state = |outcome: &Outcome, at_s: f64| {
        let sample = |value: &dyn Fn(&Sample) -> f64| interpolated(&outcome.samples, at_s, value);
        [
            height_m * sample(&|s| s.turned_rad[0]),
            height_m * sample(&|s| s.turned_rad[1]),
            sample(&|s| s.velocity[0]) / lambda_s,
            sample(&|s| s.velocity[1]) / lambda_s,
        ]
    };
    let difference = |n: usize| {
        let at_s = PUSHED_S + LASTS_S + n as f64 * stride_s;
        let (a, b) = (state(&one, at_s), state(&other, at_s));
        (0..4).map(|i| (0.5 * (a[i] - b[i])).powi(2)).sum::<f64>().sqrt()
    };
    Some((0..STRIDES).map(difference).collect())
}

fn interpolated(samples: &[Sample], at_s: f64, value: &dyn Fn(&Sample) -> f64) -> f64 {
    let after = samples.partition_point(|sample| sample.time_s < at_s).clamp(1, samples.len() - 1);
    let (a, b) = (&samples[after - 1], &samples[after]);
    let share = ((at_s - a.time_s) / (b.time_s - a.time_s)).clamp(0.0, 1.0);
    value(a) + share * (value(b) - value(a))
}

/// Factor a step, from the first stride on, as long as the difference is small and is one.
fn factor(differences: &[f64]) -> Option<f64> {
    let fit: Vec<(f64, f64)> = differences
        .iter()
        .enumerate()
        .skip(1)
        .take_while(|(_, d)| (LEAST_M..MOST_M).contains(*d))
        .map(|(n, d)| (2.0 * n as f64, d.ln()))
        .collect();
    if fit.len() < 2 {
        // Gone, or out of all bounds, within two strides.
        let (first, second) = (differences[0], differences[1]);
        return (second < LEAST_M).then(|| (second / first).sqrt());
    }
    let count = fit.len() as f64;
    let mean = |of: &dyn Fn(&(f64, f64)) -> f64| fit.iter().map(of).sum::<f64>() / count;
    let (n, d) = (mean(&|p| p.0), mean(&|p| p.1));
    let slope =
        fit.iter().map(|p| (p.0 - n) * (p.1 - d)).sum::<f64>() / fit.iter().map(|p| (p.0 - n).powi(2)).sum::<f64>();
    Some(slope.exp())
}

/// The worse direction's factor; none where it fell or left what is small at once.
fn worst(bench: &Bench, gait: &Gait, balanced: bool) -> Option<f64> {
    [[1.0, 0.0], [0.0, 1.0]]
        .into_iter()
        .try_fold(0.0_f64, |most, direction| Some(most.max(factor(&differences(bench, gait, balanced, direction)?)?)))
}

pub fn multipliers(bench: &Bench) {
    for name in bench.all_gaits().into_iter().chain(["wide".to_owned()]) {
        let gait = bench.gait(&name);
        let shown = |factor: Option<f64>| factor.map_or("none".to_owned(), |factor| format!("{factor:.2}"));
        println!(
            "multiplier_{name} = certificate {}, in MuJoCo bare {}, balanced {}",
            shown(gait.certificate.map(|certificate| certificate.largest_multiplier)),
            shown(worst(bench, &gait, false)),
            shown(worst(bench, &gait, true))
        );
    }
}
