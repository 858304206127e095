//! What is wrong with the messages that come in, kept for where a user looks: the log, the answers of services, the
//! diagnostics.

use crate::messages::StateMessage;
use control::JOINTS;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;
use tandem_msgs::builtin_interfaces::Time;

/// A problem that was not seen again for so long is over.
const MEMORY: Duration = Duration::from_secs(1);
/// Diagnostics come once a second: for so long they show a problem, whatever came after it.
const SHOWN_FOR: Duration = Duration::from_secs(2);
/// A joint that no message has named for so long is missing. Messages may carry the joints in parts.
const MISSING_AFTER: Duration = Duration::from_millis(500);
/// As many messages in a row with stamps of whole seconds are no chance.
const WHOLE_STAMPS: u32 = 20;

/// The topics whose problems are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Topic {
    /// `joint_states`.
    JointStates,
    /// `imu`.
    Imu,
    /// `cmd_vel`.
    CmdVel,
    /// `body_pose`.
    BodyPose,
    /// Not a topic: what the lease's holder alone may publish, of others.
    Lease,
}

impl Topic {
    const ALL: [Self; 5] = [Self::JointStates, Self::Imu, Self::CmdVel, Self::BodyPose, Self::Lease];

    /// Its name, relative to the node's namespace.
    pub fn name(self) -> &'static str {
        match self {
            Self::JointStates => "joint_states",
            Self::Imu => "imu",
            Self::CmdVel => "cmd_vel",
            Self::BodyPose => "body_pose",
            Self::Lease => "lease",
        }
    }
}

#[derive(Clone, Debug, Default)]
struct Problem {
    text: String,
    count: u64,
    last: Option<Duration>,
    /// A good message came after it.
    is_over: bool,
}

/// The last problem of each topic.
#[derive(Debug, Default)]
pub struct InputProblems {
    problems: Mutex<[Problem; Topic::ALL.len()]>,
}

impl InputProblems {
    /// A message at monotonic time `wall` had this wrong with it. Logged when it is new, and ever more rarely while it
    /// goes on: a publisher at 1 kHz must not fill the log.
    pub fn note(&self, topic: Topic, text: String, wall: Duration) {
        let mut problems = self.problems.lock().unwrap_or_else(PoisonError::into_inner);
        let problem = &mut problems[topic as usize];
        problem.count += 1;
        if problem.count.is_power_of_two() {
            tracing::warn!("{} ({} so far): {text}", topic.name(), problem.count);
        }
        (problem.text, problem.last, problem.is_over) = (text, Some(wall), false);
    }

    /// A message had nothing wrong with it: what is wrong with those of another publisher is not held against it.
    pub fn is_fine(&self, topic: Topic) {
        self.problems.lock().unwrap_or_else(PoisonError::into_inner)[topic as usize].is_over = true;
    }

    /// What was wrong shortly before monotonic time `wall`, in one line, also where the last message was good: what
    /// comes and goes must not hide between two diagnostics. Empty where nothing was.
    pub fn recent(&self, wall: Duration) -> String {
        self.of(&Topic::ALL, SHOWN_FOR, |_| true, wall)
    }

    /// What is wrong now and keeps a robot from being armed, from standing up and from walking: a pose of the body that
    /// is not heeded does not, nor what others publish who may not drive.
    pub fn hindering(&self, wall: Duration) -> String {
        self.of(&[Topic::JointStates, Topic::Imu, Topic::CmdVel], MEMORY, |problem| !problem.is_over, wall)
    }

    fn of(&self, topics: &[Topic], age: Duration, counts: impl Fn(&Problem) -> bool, wall: Duration) -> String {
        let problems = self.problems.lock().unwrap_or_else(PoisonError::into_inner);
        let named = topics.iter().filter_map(|&topic| {
            let problem = &problems[topic as usize];
            let is_young = problem.last.is_some_and(|last| wall.saturating_sub(last) < age);
            (is_young && counts(problem)).then(|| format!("{}: {}", topic.name(), problem.text))
        });
        named.collect::<Vec<_>>().join("; ")
    }
}

/// Looks at the joint states for what no single message shows.
#[derive(Clone, Debug, Default)]
pub struct StateWatch {
    /// In lockstep a stamp that stands still is a simulation that waits.
    stamps_may_stand: bool,
    first: Option<Duration>,
    named: [Option<Duration>; JOINTS],
    whole_stamps: u32,
}

impl StateWatch {
    /// Nothing has come yet.
    pub fn new(stamps_may_stand: bool) -> Self {
        Self { stamps_may_stand, ..Self::default() }
    }

    /// What is wrong with the state, or with those up to it. `names` are the joints', `found` the message's.
    pub fn look(&mut self, state: &StateMessage, names: &[String; JOINTS], found: &[String]) -> Option<String> {
        let first = *self.first.get_or_insert(state.wall);
        for j in (0..JOINTS).filter(|j| state.named[*j]) {
            self.named[j] = Some(state.wall);
        }
        // In a row, whether the second is another or not: a driver that counts whole seconds is wrong all the time.
        let is_whole = state.stamp.subsec_nanos() == 0;
        self.whole_stamps = if is_whole { self.whole_stamps.saturating_add(1) } else { 0 };
        self.not_finite(state, names).or_else(|| self.whole_stamp(state)).or_else(|| {
            let silent = |j: &usize| state.wall.saturating_sub(self.named[*j].unwrap_or(first)) > MISSING_AFTER;
            let missing = (0..JOINTS).find(silent)?;
            Some(format!("joint {:?} is missing; the message has {found:?}", names[missing]))
        })
    }

    fn not_finite(&self, state: &StateMessage, names: &[String; JOINTS]) -> Option<String> {
        (0..JOINTS).filter(|j| state.named[*j]).find_map(|j| {
            [("position", state.position_rad[j]), ("velocity", state.velocity_rad_s[j])]
                .into_iter()
                .find(|(_, value)| !value.is_finite())
                .map(|(what, value)| format!("the {what} of {:?} is {value}: expected a finite number", names[j]))
        })
    }

    fn whole_stamp(&self, state: &StateMessage) -> Option<String> {
        // A simulation that is paused stands at any time; zero and whole seconds are what drivers send that have no
        // time.
        (self.whole_stamps > WHOLE_STAMPS && !self.stamps_may_stand).then(|| {
            format!(
                "{} messages with the stamp {} s or other whole seconds: expected the time of each measurement, which \
                 neither zero nor whole seconds are; or the simulation is paused",
                self.whole_stamps,
                Time::from_nanoseconds(i64::try_from(state.stamp.as_nanos()).unwrap_or(i64::MAX)).seconds()
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    fn names() -> [String; JOINTS] {
        std::array::from_fn(|j| format!("joint_{j}"))
    }

    fn state(stamp: Duration, wall: Duration, named: impl Fn(usize) -> bool) -> StateMessage {
        StateMessage {
            stamp,
            wall,
            named: std::array::from_fn(named),
            position_rad: [0.1; JOINTS],
            velocity_rad_s: [0.0; JOINTS],
            torque_nm: None,
        }
    }

    #[test]
    fn stamps_of_zero_or_whole_seconds_are_named_for_what_they_are() {
        for stamp in [Duration::ZERO, Duration::from_secs(7)] {
            let mut watch = StateWatch::default();
            let problems: Vec<_> =
                (0..40).map(|k| watch.look(&state(stamp, k * 5 * MS, |_| true), &names(), &names())).collect();
            assert!(problems[..20].iter().all(Option::is_none));
            let problem = problems[30].as_ref().unwrap();
            assert!(problem.contains(&format!("the stamp {} s", stamp.as_secs())), "{problem}");
        }
        // Nor does the next second excuse them: the diagnostics might look just then.
        let mut watch = StateWatch::default();
        for k in 0..600 {
            let stamp = Duration::from_secs(u64::from(7 + k / 200));
            let problem = watch.look(&state(stamp, k * 5 * MS, |_| true), &names(), &names());
            assert_eq!(problem.is_some(), k >= 20, "message {k}");
        }
        let mut watch = StateWatch::default();
        for k in 0..100 {
            // Repeated ten times each, as a simulation does that waits for an answer.
            assert_eq!(watch.look(&state(k / 10 * MS, k * MS, |_| true), &names(), &names()), None);
        }
    }

    #[test]
    fn joint_states_in_two_parts_lack_nothing_and_a_joint_that_no_part_has_is_missing() {
        let mut watch = StateWatch::default();
        for k in 1..1000 {
            let half = |j: usize| (j < 6) == (k % 2 == 0);
            let problem = watch.look(&state(k / 2 * MS, k * MS, half), &names(), &names());
            assert_eq!(problem, None, "message {k}");
        }
        let mut watch = StateWatch::default();
        let problems: Vec<_> =
            (0..600).map(|k| watch.look(&state(k * MS, k * MS, |j| j != 3), &names(), &names())).collect();
        assert!(problems[..500].iter().all(Option::is_none));
        assert!(problems[599].as_ref().unwrap().contains("\"joint_3\" is missing"));
    }

    #[test]
    fn a_value_that_is_no_number_is_reported_by_joint_and_forgotten_when_it_is_over() {
        let mut bad = state(MS, MS, |_| true);
        bad.velocity_rad_s[4] = f64::NAN;
        let text = StateWatch::default().look(&bad, &names(), &names()).unwrap();
        assert_eq!(text, "the velocity of \"joint_4\" is NaN: expected a finite number");
        let problems = InputProblems::default();
        problems.note(Topic::JointStates, text, MS);
        assert!(problems.recent(2 * MS).starts_with("joint_states: the velocity of"));
        problems.note(Topic::Imu, "upside down".into(), MS);
        assert!(problems.recent(2 * MS).ends_with("; imu: upside down"));
        assert_eq!((problems.hindering(2 * MEMORY), problems.recent(2 * SHOWN_FOR)), (String::new(), String::new()));
        problems.is_fine(Topic::JointStates);
        assert_eq!(problems.hindering(2 * MS), "imu: upside down");
        problems.is_fine(Topic::Imu);
        problems.note(Topic::BodyPose, "refused".into(), MS);
        assert_eq!(problems.hindering(2 * MS), "");
        assert!(problems.recent(2 * MS).ends_with("; body_pose: refused"));
    }

    #[test]
    fn what_comes_and_goes_does_not_hide_between_two_diagnostics() {
        let problems = InputProblems::default();
        for k in 0..3000 {
            match k % 500 {
                0 => problems.note(Topic::Imu, "upside down".into(), k * MS),
                _ => problems.is_fine(Topic::Imu),
            }
            let (shown, hinders) = (problems.recent(k * MS), problems.hindering(k * MS));
            assert_eq!((shown.as_str(), hinders.is_empty()), ("imu: upside down", k % 500 != 0), "after {k} ms");
        }
    }
}
