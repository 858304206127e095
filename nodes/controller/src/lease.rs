//! The lease: while one program has claimed the robot, what would move it is refused to the others, by the holder's
//! name. It keeps friends out of each other's way; whoever means harm is kept out by DDS Security (docs/security.md).

use crate::inputs::{InputProblems, Topic};
use realtime::monotonic_now;
use ros::{Departure, ProgramId, PublisherId};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tandem_msgs::text::printable;
use tandem_msgs::{ClaimRequest, text};

/// Characters of a holder's name.
const NAME_CHARS: usize = 64;
/// Longest claim, s.
const MOST_S: f64 = 86_400.0;

/// Who drives, if anybody has claimed it. Times are of the monotonic clock.
#[derive(Debug, Default)]
pub struct Lease(Mutex<Option<Held>>);

#[derive(Clone, Debug, PartialEq)]
struct Held {
    program: ProgramId,
    name: String,
    until: Option<Duration>,
}

impl Held {
    fn is_over(&self, now: Duration) -> bool {
        self.until.is_some_and(|until| until <= now)
    }

    fn words(&self, now: Duration) -> String {
        match self.until {
            Some(until) => format!("\"{}\" for {:.1} s more", self.name, until.saturating_sub(now).as_secs_f64()),
            None => format!("\"{}\" until it is released", self.name),
        }
    }
}

impl Lease {
    /// What counts now: a claim whose time is over is none.
    fn held(&self, now: Duration) -> MutexGuard<'_, Option<Held>> {
        // What is guarded is whole after a panic elsewhere.
        let mut held = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if held.as_ref().is_some_and(|held| held.is_over(now)) {
            *held = None;
        }
        held
    }

    /// Claims, renews or takes over. Either way a sentence for people.
    ///
    /// # Errors
    /// An invalid value, or somebody else holds it.
    pub fn claim(&self, program: ProgramId, request: &ClaimRequest, now: Duration) -> Result<String, String> {
        let ClaimRequest { name, duration_s, take } = request;
        if name.trim().is_empty() || name.chars().count() > NAME_CHARS || printable(name, text::NAME_CHARS) != *name {
            let shown = printable(name, NAME_CHARS);
            return Err(format!("name is \"{shown}\"; expected 1 to {NAME_CHARS} characters that can be read"));
        }
        if !(0.0..=MOST_S).contains(duration_s) {
            return Err(format!("duration_s is {duration_s}; expected 0 to {MOST_S}"));
        }
        let mut held = self.held(now);
        let before = held.take_if(|_| *take);
        if let Some(other) = held.as_ref().filter(|held| held.program != program) {
            return Err(format!("claimed by {}; claim it with take, or wait", other.words(now)));
        }
        let until = (*duration_s > 0.0).then(|| now + Duration::from_secs_f64(*duration_s));
        let claimed = held.insert(Held { program, name: name.clone(), until });
        let from = before.filter(|before| before.program != program);
        let from = from.map_or_else(String::new, |before| format!(", taken from \"{}\"", before.name));
        Ok(format!("claimed by {}{from}", claimed.words(now)))
    }

    /// Gives back what this program holds.
    ///
    /// # Errors
    /// Nobody holds it, or somebody else does.
    pub fn release(&self, program: ProgramId, now: Duration) -> Result<String, String> {
        let mut held = self.held(now);
        match held.take_if(|held| held.program == program) {
            Some(own) => Ok(format!("released by \"{}\"", own.name)),
            None => Err(held.as_ref().map_or_else(
                || "it is not claimed".to_owned(),
                |other| format!("claimed by {}, which alone releases it", other.words(now)),
            )),
        }
    }

    /// Why this program may not move the robot now.
    pub fn refusal(&self, program: ProgramId, now: Duration) -> Option<String> {
        let held = self.held(now);
        let other = held.as_ref().filter(|held| held.program != program)?;
        Some(format!("refused: claimed by {}", other.words(now)))
    }

    /// Programs are gone. Gives the name of the holder, if it is one of them.
    pub fn left(&self, departure: Departure, now: Duration) -> Option<String> {
        self.held(now).take_if(|held| departure.covers_program(held.program)).map(|held| held.name)
    }

    /// Nobody holds it any more.
    pub fn end(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }

    /// Who holds it, for diagnostics; empty: nobody.
    pub fn holder(&self, now: Duration) -> String {
        self.held(now).as_ref().map_or_else(String::new, |held| held.name.clone())
    }
}

/// What the topics that move the robot ask before they heed a message.
#[derive(Clone)]
pub struct Gate {
    /// Who drives.
    pub lease: Arc<Lease>,
    /// Where it is kept that somebody else would.
    pub problems: Arc<InputProblems>,
}

impl Gate {
    /// Whether this publisher may drive: while the robot is claimed, its holder's alone. Another one's message is as
    /// none; where a user looks it says whose and why.
    pub fn heeds(&self, topic: Topic, publisher: PublisherId) -> bool {
        let now = monotonic_now();
        let refusal = self.lease.refusal(publisher.program(), now);
        if let Some(refusal) = &refusal {
            self.problems.note(Topic::Lease, format!("{} of another program {refusal}", topic.name()), now);
        }
        refusal.is_none()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ONE: ProgramId = ProgramId([1; 12]);
    const OTHER: ProgramId = ProgramId([2; 12]);

    fn at(seconds: f64) -> Duration {
        Duration::from_secs_f64(seconds)
    }

    fn request(name: &str, duration_s: f64, take: bool) -> ClaimRequest {
        ClaimRequest { name: name.into(), duration_s, take }
    }

    #[test]
    fn nobody_is_refused_before_it_is_claimed() {
        let lease = Lease::default();
        assert_eq!(lease.refusal(ONE, at(1.0)), None);
        assert_eq!(lease.release(ONE, at(1.0)), Err("it is not claimed".into()));
        assert_eq!(lease.holder(at(1.0)), "");
    }

    #[test]
    fn a_claim_refuses_the_others_by_name_until_its_time_is_over() {
        let lease = Lease::default();
        assert_eq!(
            lease.claim(ONE, &request("tablet", 5.0, false), at(1.0)).unwrap(),
            "claimed by \"tablet\" for 5.0 s more"
        );
        assert_eq!(lease.refusal(ONE, at(2.0)), None);
        assert_eq!(lease.refusal(OTHER, at(2.0)).unwrap(), "refused: claimed by \"tablet\" for 4.0 s more");
        assert!(
            lease.claim(OTHER, &request("laptop", 0.0, false), at(2.0)).unwrap_err().contains("\"tablet\" for 4.0 s")
        );
        assert!(lease.release(OTHER, at(2.0)).unwrap_err().contains("which alone releases it"));
        // Claimed again it counts anew.
        lease.claim(ONE, &request("tablet", 5.0, false), at(5.0)).unwrap();
        assert!(lease.refusal(OTHER, at(9.9)).is_some());
        assert_eq!(lease.refusal(OTHER, at(10.0)), None);
        assert_eq!(lease.holder(at(10.0)), "");
    }

    #[test]
    fn a_claim_ends_by_release_by_the_holder_s_leave_and_by_take() {
        let lease = Lease::default();
        lease.claim(ONE, &request("tablet", 0.0, false), at(1.0)).unwrap();
        assert!(lease.refusal(OTHER, at(1e6)).unwrap().contains("until it is released"));
        assert_eq!(lease.release(ONE, at(2.0)).unwrap(), "released by \"tablet\"");
        assert_eq!(lease.refusal(OTHER, at(2.0)), None);

        lease.claim(ONE, &request("tablet", 0.0, false), at(3.0)).unwrap();
        assert_eq!(lease.left(Departure::of_program(OTHER, true), at(3.0)), None);
        assert_eq!(lease.left(Departure::of_program(ONE, false), at(3.0)).unwrap(), "tablet");
        assert_eq!(lease.refusal(OTHER, at(3.0)), None);

        lease.claim(ONE, &request("tablet", 0.0, false), at(4.0)).unwrap();
        let taken = lease.claim(OTHER, &request("laptop", 0.0, true), at(4.0)).unwrap();
        assert_eq!(taken, "claimed by \"laptop\" until it is released, taken from \"tablet\"");
        assert!(lease.refusal(ONE, at(4.0)).unwrap().contains("laptop"));
        lease.end();
        assert_eq!(lease.refusal(ONE, at(4.0)), None);
    }

    #[test]
    fn while_it_is_claimed_the_holder_s_publishers_alone_are_heeded_and_nobody_is_hindered_by_the_others() {
        let gate = Gate { lease: Arc::default(), problems: Arc::default() };
        let [own, other] = [1, 2].map(|n| PublisherId([n; 16]));
        assert!(gate.heeds(Topic::CmdVel, own) && gate.heeds(Topic::CmdVel, other));
        gate.lease.claim(ONE, &request("tablet", 0.0, false), monotonic_now()).unwrap();
        assert!(gate.heeds(Topic::CmdVel, own) && !gate.heeds(Topic::CmdVel, other));
        let now = monotonic_now();
        let told = "lease: cmd_vel of another program refused: claimed by \"tablet\" until it is released";
        assert_eq!((gate.problems.recent(now).as_str(), gate.problems.hindering(now).as_str()), (told, ""));
        gate.lease.end();
        assert!(gate.heeds(Topic::BodyPose, other));
    }

    #[test]
    fn what_cannot_be_meant_claims_nothing() {
        let lease = Lease::default();
        for (name, duration_s) in [("", 1.0), (" ", 1.0), ("a\nb", 1.0), ("x", -1.0), ("x", f64::NAN), ("x", 86_401.0)]
        {
            assert!(lease.claim(ONE, &request(name, duration_s, true), at(0.0)).is_err(), "{name:?} {duration_s}");
        }
        assert!(lease.claim(ONE, &request(&"x".repeat(65), 1.0, false), at(0.0)).is_err());
        assert_eq!(lease.refusal(OTHER, at(0.0)), None);
        // Not even one that would take it.
        lease.claim(ONE, &request("tablet", 0.0, false), at(0.0)).unwrap();
        assert!(lease.claim(OTHER, &request("", 0.0, true), at(0.0)).is_err());
        assert_eq!(lease.holder(at(0.0)), "tablet");
    }
}
