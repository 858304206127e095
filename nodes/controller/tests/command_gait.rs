//! When a gait is asked for because of the command, and what becomes of one that comes.

use control::balanced::BalanceConfig;
use control::{Config, Mode, PreparedGait};
use gait::Gait;
use robot::Robot;
use std::path::Path;
use tandem_controller::command_gait::{CommandGaits, Rule, Task};
use tandem_msgs::GenerateGaitRequest;

/// What could not be had is asked for again after so long, s.
const RETRY_S: f64 = 10.0;

/// A walk of the amble of the tests, which was planned for 0.35 m/s.
struct Walk {
    gaits: CommandGaits,
    config: Config,
    gait: Gait,
    prepared: PreparedGait,
}

impl Walk {
    fn new() -> Self {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60");
        let robot = Robot::load(&folder).unwrap();
        let balance = BalanceConfig::for_robot(&robot).unwrap();
        let config = Config { balance: Some(balance), ..Config::for_robot(&robot) };
        let rule =
            Rule { grown_s: 2.0, timeout_s: 0.5, most_m_s: [0.6, 1.0], ..Rule::new(0.15, 1.0, &config, &balance) };
        let gait = Gait::from_json(include_str!("../../../tests/gaits/amble.json")).unwrap();
        let prepared = PreparedGait::new(&gait, &config).unwrap();
        let walk = Self { gaits: CommandGaits::new(rule, config.clone()), config, gait, prepared };
        walk.gaits.take(&walk.gait, &walk.prepared).unwrap();
        walk
    }

    /// It is in this mode at this time.
    fn at(&self, now_s: f64, mode: Mode) {
        self.gaits.follow((1000.0 * now_s).round() as u64, mode);
    }

    /// Walks for so long, is asked for that at each time, and looks every 0.1 s: when a gait is asked for, and for
    /// what.
    fn wanted(&self, seconds: f64, asked: impl Fn(f64) -> Option<f64>) -> Vec<(f64, GenerateGaitRequest)> {
        let looked = (0..=(10.0 * seconds).round() as u32).map(|n| 0.1 * f64::from(n));
        let look = |now_s: f64| {
            self.at(now_s, Mode::Walking);
            asked(now_s).into_iter().for_each(|speed_m_s| self.gaits.hear(speed_m_s));
            match self.gaits.next() {
                Some(Task::Plan(request)) => Some((now_s, *request)),
                Some(Task::GoBack(_)) => panic!("it walks"),
                None => None,
            }
        };
        looked.filter_map(look).collect()
    }

    /// When a gait is asked for, and its speed, m/s.
    fn speeds(&self, seconds: f64, asked: impl Fn(f64) -> Option<f64>) -> Vec<(f64, f64)> {
        self.wanted(seconds, asked).into_iter().map(|(at_s, request)| (at_s, request.speed_m_s.0[0])).collect()
    }

    /// The walked gait, as if it had been planned for what stepping in place asks for.
    fn answer(&self) -> Gait {
        let request = self.wanted(5.0, |_| Some(0.0)).pop().expect("a gait is asked for").1;
        let mut answer = self.gait.clone();
        answer.request["speed_m_s"] = request.speed_m_s.0[0].into();
        answer
    }
}

#[test]
fn a_command_that_is_held_far_from_the_gaits_own_speed_asks_for_a_gait_once_the_walk_has_grown() {
    let wanted = Walk::new().speeds(6.0, |_| Some(0.8));
    let [(at_s, speed_m_s)] = wanted[..] else { panic!("{wanted:?}") };
    // No further than a fifth of the greatest speed at once.
    let own_m_s = Walk::new().gait.speed_m_s();
    assert!((3.0..3.2).contains(&at_s) && (speed_m_s - (own_m_s + 0.2)).abs() < 1e-9, "{wanted:?}");
    let wanted = Walk::new().speeds(6.0, |_| Some(0.17));
    assert!(matches!(wanted[..], [(_, speed_m_s)] if (speed_m_s - 0.17).abs() < 1e-9), "{wanted:?}");
}

#[test]
fn what_is_near_or_not_held_or_was_never_asked_asks_for_none() {
    assert_eq!(Walk::new().speeds(20.0, |_| Some(0.45)), []);
    assert_eq!(Walk::new().speeds(20.0, |_| None), []);
    // A hand on a stick: never for a second within half of the distance.
    let restless = |now_s: f64| Some(if ((now_s / 0.7) as u32).is_multiple_of(2) { 0.8 } else { 0.0 });
    assert_eq!(Walk::new().speeds(20.0, restless), []);
    // One that trembles about a speed is held.
    let trembling = |now_s: f64| Some(0.8 + 0.03 * (10.0 * now_s).sin());
    assert_eq!(Walk::new().speeds(6.0, trembling).len(), 1);
}

#[test]
fn a_command_that_falls_silent_counts_as_standing_still() {
    let wanted = Walk::new().speeds(10.0, |now_s| (now_s < 4.0).then_some(0.35));
    let [(at_s, speed_m_s)] = wanted[..] else { panic!("{wanted:?}") };
    assert!((5.4..5.8).contains(&at_s) && (0.1..0.2).contains(&speed_m_s), "{wanted:?}");
}

#[test]
fn what_could_not_be_had_is_asked_for_again_after_a_while_and_what_is_new_at_once() {
    let times: Vec<f64> = Walk::new().speeds(30.0, |_| Some(0.1)).iter().map(|(at_s, _)| *at_s).collect();
    assert!(times.len() == 3 && times.windows(2).all(|pair| pair[1] - pair[0] > RETRY_S - 0.11), "{times:?}");
    let wanted = Walk::new().speeds(8.0, |now_s| Some(if now_s < 5.0 { 0.1 } else { 0.8 }));
    assert!(wanted.len() == 2 && wanted[1].1 > 0.5, "{wanted:?}");
}

#[test]
fn a_command_beyond_the_robots_greatest_speed_is_that_speed() {
    let walk = Walk::new();
    let mut fast = walk.gait.clone();
    fast.step_length_m = 0.9 * fast.step_duration_s;
    walk.gaits.take(&fast, &walk.prepared).unwrap();
    assert_eq!(walk.speeds(6.0, |_| Some(5.0)), [], "0.9 is within 0.15 of 1.0");
}

#[test]
fn the_request_is_the_loaded_gaits_and_its_gait_is_handed_over_and_taken_back_after_the_walk() {
    let walk = Walk::new();
    let request = walk.wanted(5.0, |_| Some(0.8)).pop().unwrap().1;
    assert_eq!((request.behaviour.as_str(), request.half_width_m.0.as_slice()), ("amble", &[0.25][..]));
    assert_eq!((request.torque_limit_nm.len(), request.clearance_m.0.as_slice()), (3, &[0.13][..]));
    let mut answer = walk.gait.clone();
    answer.request["speed_m_s"] = request.speed_m_s.0[0].into();
    walk.gaits.take(&answer, &walk.prepared).unwrap();
    assert!(walk.gaits.status().starts_with("walks a gait planned for"), "{}", walk.gaits.status());
    // Over: what somebody loaded is walked next, and that is said once.
    walk.at(20.0, Mode::Stopping);
    assert!(walk.gaits.next().is_none());
    walk.at(21.0, Mode::Standing);
    let Some(Task::GoBack(back)) = walk.gaits.next() else { panic!("{}", walk.gaits.status()) };
    assert_eq!(*back, walk.gait);
    walk.gaits.take(&back, &walk.prepared).unwrap();
    assert!(walk.gaits.next().is_none());
}

#[test]
fn a_gait_that_comes_too_late_is_not_handed_over_and_is_nobody_elses() {
    // The planner did not answer in time.
    let walk = Walk::new();
    let late = walk.answer();
    assert!(walk.gaits.fail("no answer") && !walk.gaits.fail("no answer"), "it is said once");
    assert!(walk.gaits.take(&late, &walk.prepared).unwrap_err().contains("none any more"));
    // The walk has ended.
    let walk = Walk::new();
    let late = walk.answer();
    walk.at(6.0, Mode::Standing);
    assert!(walk.gaits.take(&late, &walk.prepared).unwrap_err().contains("none any more"));
    // Somebody has loaded another gait.
    let walk = Walk::new();
    let late = walk.answer();
    walk.gaits.take(&walk.gait, &walk.prepared).unwrap();
    assert!(walk.gaits.take(&late, &walk.prepared).unwrap_err().contains("none any more"));
}

/// It would stop the walk: the controller stops, stands and begins again with a gait that begins elsewhere.
#[test]
fn a_gait_that_begins_far_from_where_the_walked_one_ends_is_not_handed_over() {
    let walk = Walk::new();
    let mut far = walk.answer();
    let (hips, joints) = (1, 3);
    for leg in 0..4 {
        let joint = joints * leg + hips;
        far.coefficients_rad[joint].iter_mut().for_each(|value| *value += 0.1);
        far.reference_coefficients_rad[joint].iter_mut().for_each(|value| *value += 0.1);
        far.initial.joint_position_rad[joint] += 0.1;
    }
    let prepared = PreparedGait::new(&far, &walk.config).unwrap();
    assert!(walk.gaits.take(&far, &prepared).unwrap_err().contains("too far"));
    assert!(walk.gaits.status().contains("too far"), "{}", walk.gaits.status());
    // From anybody else it is taken all the same: that is what the controller stops for.
    walk.gaits.take(&far, &prepared).unwrap();
}

/// The planner's service plans the trot alone.
#[test]
fn a_gait_of_another_contact_schedule_asks_for_no_trot() {
    let walk = Walk::new();
    let crawl = Gait { cycle: walk.gait.schedule(), ..walk.gait.clone() };
    walk.gaits.take(&crawl, &PreparedGait::new(&crawl, &walk.config).unwrap()).unwrap();
    assert_eq!(walk.speeds(20.0, |_| Some(0.8)), []);
    assert!(walk.gaits.status().contains("none is planned for commands"), "{}", walk.gaits.status());
    // A trot that somebody loads is planned for again.
    walk.gaits.take(&walk.gait, &walk.prepared).unwrap();
    let asked = (210..=260).filter_map(|tenth| {
        walk.at(0.1 * f64::from(tenth), Mode::Walking);
        walk.gaits.hear(0.8);
        walk.gaits.next()
    });
    assert_eq!(asked.count(), 1);
}
