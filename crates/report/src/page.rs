//! The report as one self-contained page: no network, no fonts, no scripts from elsewhere.

use gait::{Gait, JOINTS_PER_LEG, LEGS};
use serde_json::{Value, json};

use crate::balanced::Way;
use crate::numbers::{list, rounded};
use crate::planned_stride::planned_orbit;
use crate::run::{STANDING_N, from};
use crate::{Balanced, ReportError, Sample, mean_absolute_torque_nm, mean_forward_speed_m_s, table_two};

const TEMPLATE: &str = include_str!("page.html");

/// Points of a curve that the page holds: more cannot be distinguished on a screen.
const POINTS: usize = 4000;
/// No recording is older, s since the epoch.
const YEAR_2000_S: f64 = 946_684_800.0;
/// Bins of the histogram of control cycles.
const BINS: usize = 80;

/// One run of a page. Parts that are not known are left out of it.
#[derive(Clone, Debug)]
pub struct PageRun<'a> {
    /// What the run is called.
    pub label: String,
    /// The first sample's time, s since the epoch; one that lies before 2000 is a simulation's own time.
    pub begun_s: f64,
    /// The gait that was walked, if it is known.
    pub gait: Option<&'a Gait>,
    /// Samples in the order of time.
    pub samples: &'a [Sample],
    /// When the robot began to walk, s.
    pub walking_from_s: f64,
    /// When it stopped walking; the last sample's time if it did not.
    pub walking_to_s: f64,
    /// Whether base position, orientation and velocity in the samples are known.
    pub has_body: bool,
    /// Whether they are the truth, and not the controller's estimate.
    pub has_truth: bool,
    /// What the balanced law saw and did, in the order of time; empty where the paper's law walked.
    pub balanced: &'a [Balanced],
    /// Whether ground forces are known.
    pub has_ground: bool,
    /// Whether torques are known.
    pub has_torque: bool,
    /// What happened when, s.
    pub events: &'a [(f64, String)],
    /// Time and largest tracking error over the joints, rad.
    pub tracking_error: &'a [(f64, f64)],
    /// Times from one control cycle to the next, s.
    pub cycle_intervals_s: &'a [f64],
    /// Control cycles that the recording lacks.
    pub missing_cycles: u64,
    /// The robot's shape over time, if its description is known.
    pub skeleton: Option<Skeleton>,
    /// A picture of one step as PNG, if there is one.
    pub tiles_png: Option<Vec<u8>>,
}

/// Where the robot's joints are over time, in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct Skeleton {
    /// Time of the first frame, s.
    pub from_s: f64,
    /// Time from frame to frame, s.
    pub step_s: f64,
    /// The base, then for each leg hip roll, hip pitch, knee and toe, m.
    pub frames: Vec<[[f64; 3]; 1 + 4 * LEGS]>,
}

/// When a page was made, and by what.
#[derive(Clone, Copy, Debug)]
pub struct Made<'a> {
    /// s since the epoch.
    pub at_s: u64,
    /// The program and its version.
    pub by: &'a str,
}

/// The page's HTML.
///
/// # Errors
/// [`ReportError::TooLittle`] if there is no run, or a run without samples.
pub fn page(title: &str, made: Made, runs: &[PageRun]) -> Result<String, ReportError> {
    let too_little = |run: &str, problem: &str| ReportError::TooLittle { run: run.into(), problem: problem.into() };
    if runs.is_empty() {
        return Err(too_little(title, "no run; expected at least one"));
    }
    let mut data = Vec::new();
    for run in runs {
        if run.samples.len() < 2 {
            return Err(too_little(&run.label, "less than two samples; expected a recording of some seconds"));
        }
        data.push(run_data(run));
    }
    // "</" would end the script element that holds the data.
    let text = json!({ "runs": data, "made_s": made.at_s, "made_by": made.by }).to_string().replace("</", "<\\/");
    Ok(TEMPLATE.replace("__TITLE__", &escaped(title)).replace("__DATA__", &text))
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn run_data(run: &PageRun) -> Value {
    let samples = run.samples;
    let end_s = samples[samples.len() - 1].time_s;
    let settled = settled(run);
    let every = samples.len().div_ceil(POINTS).max(1);
    let thin: Vec<&Sample> = samples.iter().step_by(every).collect();
    let stride_s = run.gait.map_or(0.5, |gait| gait.stride_duration_s());
    let course = |value: &dyn Fn(&Sample) -> f64| thin.iter().map(|sample| value(sample)).collect::<Vec<f64>>();
    let smooth = |value: &dyn Fn(&Sample) -> f64| -> Vec<f64> {
        let all: Vec<(f64, f64)> = samples.iter().map(|sample| (sample.time_s, value(sample))).collect();
        crate::figures::averaged(&all, stride_s).iter().step_by(every).map(|point| point.1).collect()
    };
    let forward = |sample: &Sample| {
        let (sin, cos) = sample.base_roll_pitch_yaw_rad[2].sin_cos();
        cos * sample.base_linear_velocity_m_s[0] + sin * sample.base_linear_velocity_m_s[1]
    };
    let torque: Vec<Value> = (0..JOINTS_PER_LEG)
        .map(|joint| {
            let mean = |sample: &Sample| {
                (0..LEGS).map(|leg| sample.joint_torque_nm[leg * JOINTS_PER_LEG + joint].abs()).sum::<f64>()
                    / LEGS as f64
            };
            json!(list(smooth(&mean).into_iter(), 0.01))
        })
        .collect();
    let known = |condition: bool, value: Value| if condition { value } else { json!([]) };
    let numbers = |values: Vec<f64>, step: f64| json!(list(values.into_iter(), step));
    let angle = |axis: usize| numbers(course(&|sample| sample.base_roll_pitch_yaw_rad[axis].to_degrees()), 0.01);
    let force = |leg: usize| numbers(course(&|sample| sample.ground_force_n[leg]), 0.1);
    let stance: Vec<Vec<[f64; 2]>> = (0..LEGS)
        .map(|leg| {
            let found =
                crate::figures::stretches(samples, |sample| run.has_ground && sample.ground_force_n[leg] > STANDING_N);
            found.into_iter().map(|(from, to)| [rounded(from, 0.001), rounded(to, 0.001)]).collect()
        })
        .collect();
    json!({
        "label": run.label,
        "origin": origin(run),
        "begun_s": (run.begun_s >= YEAR_2000_S).then_some(run.begun_s),
        "gait": run.gait.map(|gait| gait.name.as_str()),
        "end_s": end_s,
        "walking_from_s": run.walking_from_s,
        "has_torque": run.has_torque, "has_body": run.has_body, "has_ground": run.has_ground,
        "t": numbers(course(&|sample| sample.time_s), 0.001),
        "torque": known(run.has_torque, json!(torque)),
        "height": known(run.has_body, numbers(course(&|sample| sample.base_position_m[2]), 0.0001)),
        "tilt": known(run.has_body, json!([angle(0), angle(1)])),
        "speed": known(run.has_body, numbers(smooth(&forward), 0.001)),
        "force": known(run.has_ground, json!((0..LEGS).map(force).collect::<Vec<_>>())),
        "stance": stance,
        "balance": Way { gait: run.gait, samples, balanced: run.balanced, has_truth: run.has_truth }.data(),
        "tracking_t": list(run.tracking_error.iter().map(|entry| entry.0), 0.001),
        "tracking": list(run.tracking_error.iter().map(|entry| entry.1), 0.0001),
        "events": run.events.iter().map(|(time, text)| json!([rounded(*time, 0.001), text])).collect::<Vec<_>>(),
        "mean_torque": run.has_torque.then(|| mean_absolute_torque_nm(settled)),
        "largest_multiplier": run.gait.and_then(|g| g.certificate).map(|c| c.largest_multiplier), "speed_asked": run.gait.map(Gait::speed_m_s),
        "speed_got": run.has_body.then(|| mean_forward_speed_m_s(settled)),
        "table_two": run.gait.and_then(|gait| table_two(&gait.robot, &gait.name)).map(|paper| json!({
            "mujoco": paper.mujoco_nm, "experiment": paper.experiment_nm,
        })),
        "planned": run.gait.map_or(Vec::new(), planned),
        "portrait": portrait(run, settled),
        "timing": timing(run),
        "skeleton": run.skeleton.as_ref().map(skeleton_data),
        "tiles": run.tiles_png.as_ref().map(|png| format!("data:image/png;base64,{}", base64(png))),
    })
}

fn skeleton_data(skeleton: &Skeleton) -> Value {
    // Whole millimetres.
    let frames = skeleton
        .frames
        .iter()
        .map(|frame| frame.iter().flatten().map(|value| (value * 1000.0).round() as i64).collect::<Vec<_>>());
    json!({ "from_s": skeleton.from_s, "step_s": skeleton.step_s, "frames": frames.collect::<Vec<_>>() })
}

/// Two seconds into the walk, as in the pictures; all of a run that is shorter.
fn settled<'a>(run: &PageRun<'a>) -> &'a [Sample] {
    let walked = &run.samples[..run.samples.partition_point(|sample| sample.time_s <= run.walking_to_s)];
    let late = from(walked, run.walking_from_s + 2.0);
    let long_enough = |samples: &[Sample]| matches!(samples, [first, .., last] if last.time_s - first.time_s > 1.0);
    if long_enough(late) { late } else { from(walked, run.walking_from_s) }
}

/// Whether the run is a simulation's, as far as its times say: in lockstep no cycle is longer than another.
fn origin(run: &PageRun) -> &'static str {
    let even = run.cycle_intervals_s.len() > 1
        && run.cycle_intervals_s.iter().all(|interval| (interval - run.cycle_intervals_s[0]).abs() < 1e-7);
    match (run.begun_s < YEAR_2000_S, even) {
        (true, true) => "simulated, lockstep",
        (true, false) => "simulated",
        (false, _) => "recorded",
    }
}

/// For each joint type, for each leg: positions and velocities.
fn portrait(run: &PageRun, settled: &[Sample]) -> Value {
    let every = settled.len().div_ceil(POINTS).max(1);
    let side = |leg: usize, joint: usize| {
        if leg < LEGS / 2 { 1.0 } else { run.gait.map_or([-1.0, 1.0, 1.0][joint], |gait| gait.mirror.sign[joint]) }
    };
    let panels: Vec<Value> = (0..JOINTS_PER_LEG)
        .map(|joint| {
            let legs: Vec<Value> = (0..LEGS)
                .map(|leg| {
                    let (index, sign) = (leg * JOINTS_PER_LEG + joint, side(leg, joint));
                    let picked = || settled.iter().step_by(every);
                    json!([
                        list(picked().map(|sample| sign * sample.joint_position_rad[index]), 0.0001),
                        list(picked().map(|sample| sign * sample.joint_velocity_rad_s[index]), 0.001),
                    ])
                })
                .collect();
            json!(legs)
        })
        .collect();
    json!(panels)
}

/// The planned orbits of the left legs' joints: positions and velocities.
fn planned(gait: &Gait) -> Vec<Value> {
    (0..JOINTS_PER_LEG * LEGS / 2)
        .map(|joint| {
            let points = planned_orbit(gait, joint, 100);
            json!([list(points.iter().map(|p| p.0), 0.0001), list(points.iter().map(|p| p.1), 0.001)])
        })
        .collect()
}

fn timing(run: &PageRun) -> Option<Value> {
    let mut sorted = run.cycle_intervals_s.to_vec();
    sorted.sort_by(f64::total_cmp);
    let (first, last) = (*sorted.first()?, *sorted.last()?);
    let at = |share: f64| sorted[((sorted.len() - 1) as f64 * share) as usize];
    // A run on simulated time has one interval; it still deserves a bar in the middle.
    let half = ((last - first) / 2.0).max(0.1 * last.abs()).max(1e-6);
    let (from_s, to_s) = ((first + last) / 2.0 - half * 1.05, (first + last) / 2.0 + half * 1.05);
    let mut counts = vec![0_u64; BINS];
    for interval in &sorted {
        let bin = ((interval - from_s) / (to_s - from_s) * BINS as f64) as usize;
        counts[bin.min(BINS - 1)] += 1;
    }
    Some(json!({
        "count": sorted.len(), "median_s": at(0.5), "high_s": at(0.999), "longest_s": last, "missing": run.missing_cycles,
        "from_s": from_s, "to_s": to_s, "counts": counts,
    }))
}

/// RFC 4648.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for group in bytes.chunks(3) {
        let word = group.iter().fold(0_u32, |word, byte| word << 8 | u32::from(*byte)) << (8 * (3 - group.len()));
        for digit in 0..4 {
            if digit <= group.len() {
                text.push(char::from(DIGITS[(word >> (18 - 6 * digit) & 63) as usize]));
            } else {
                text.push('=');
            }
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_as_in_the_standard() {
        for (plain, coded) in [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")] {
            assert_eq!(base64(plain.as_bytes()), coded);
        }
    }

    fn run<'a>(samples: &'a [Sample], events: &'a [(f64, String)]) -> PageRun<'a> {
        PageRun {
            label: "a <run> & \"more\"".into(),
            begun_s: 0.0,
            gait: None,
            samples,
            walking_from_s: 0.0,
            walking_to_s: 10.0,
            has_body: false,
            has_truth: false,
            balanced: &[],
            has_ground: false,
            has_torque: false,
            events,
            tracking_error: &[],
            cycle_intervals_s: &[0.001, 0.0011, 0.5],
            missing_cycles: 3,
            skeleton: None,
            tiles_png: None,
        }
    }

    #[test]
    fn nothing_in_the_data_can_end_the_script_that_holds_it() {
        let sample = |time_s: f64| Sample {
            time_s,
            base_position_m: [0.0; 3],
            base_roll_pitch_yaw_rad: [0.0; 3],
            base_linear_velocity_m_s: [0.0; 3],
            joint_position_rad: [0.1; 12],
            joint_velocity_rad_s: [0.0; 12],
            joint_torque_nm: [0.0; 12],
            ground_force_n: [0.0; 4],
        };
        let samples: Vec<Sample> = (0..100).map(|i| sample(f64::from(i) * 0.01)).collect();
        let events = [(0.5, "</script><script>alert(1)</script>".to_owned())];
        let made = Made { at_s: 1_700_000_000, by: "tandem" };
        let html = page("<b>title</b>", made, &[run(&samples, &events)]).unwrap();
        assert_eq!(html.matches("<script").count(), 2 + 1, "the event's own is inside the data");
        assert_eq!(html.matches("</script>").count(), 2);
        assert!(html.contains("&lt;b&gt;title"));
        assert!(!html.contains("http:") && !html.contains("https:"), "no network");
        assert!(matches!(page("t", made, &[]), Err(ReportError::TooLittle { .. })));
        assert!(matches!(page("t", made, &[run(&samples[..1], &[])]), Err(ReportError::TooLittle { .. })));
    }

    #[test]
    fn a_run_says_whether_it_was_simulated() {
        let events = [];
        let of = |begun_s: f64, intervals: &[f64]| {
            origin(&PageRun { begun_s, cycle_intervals_s: intervals, ..run(&[], &events) })
        };
        assert_eq!(of(0.0, &[0.001; 5]), "simulated, lockstep");
        assert_eq!(of(12.0, &[0.001, 0.0013]), "simulated");
        assert_eq!(of(1_790_000_000.0, &[0.001; 5]), "recorded");
    }
}
