//! What others say to the simulation: commands, pushes and services. The middleware's threads only fill the inbox.

use crate::config::{Config, Pace};
use crate::inbox::{Answer, Ask, Inbox, Request};
use crate::ports;
use ros::{Node, Qos, RosError};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::channel;
use std::time::Duration;
use tandem_msgs::geometry_msgs::WrenchStamped;
use tandem_msgs::std_srvs::{SetBool, SetBoolResponse, Trigger, TriggerResponse};

/// A service gives up on the simulation's thread after this time.
const SERVICE_PATIENCE: Duration = Duration::from_secs(3);

/// Puts joint commands into the inbox, and counts those that are refused.
pub(super) fn listen_to_commands(
    node: &Node,
    config: &Config,
    names: [String; 12],
    inbox: &Arc<Inbox>,
    refused: &Arc<AtomicU64>,
) -> Result<(), RosError> {
    let commands = match config.pace {
        // Only the newest counts: nobody is to send an old one again.
        Pace::Realtime => Qos::best_effort(1),
        // Nothing may be lost between two processes that wait for each other.
        Pace::Lockstep => Qos::reliable(10),
    };
    let (to, refused) = (Arc::clone(inbox), Arc::clone(refused));
    node.subscribe("joint_command", commands, move |message: tandem_msgs::JointCommand| {
        match ports::joint_command(&message, &names) {
            Ok(command) => to.put_command(Answer { stamp_ns: message.header.stamp.nanoseconds(), command }),
            Err(reason) => {
                // Logged once in ten thousand: a wrong publisher at 1 kHz must not fill the log.
                if refused.fetch_add(1, Ordering::Relaxed).is_multiple_of(10_000) {
                    tracing::warn!("joint_command refused: {reason}");
                }
                to.put_refusal(reason);
            }
        }
    })
}

/// Puts pushes and what the services are asked into the inbox.
pub(super) fn listen_to_requests(node: &Node, inbox: &Arc<Inbox>) -> Result<(), RosError> {
    let to = Arc::clone(inbox);
    node.subscribe("push", Qos::reliable(10), move |message: WrenchStamped| {
        let f = message.wrench.force;
        let force = [f.x, f.y, f.z];
        if force.iter().any(|v| !v.is_finite()) {
            tracing::warn!("push refused: the force is {force:?}, expected finite numbers");
        } else if !to.put_request(Request { ask: Ask::Push(force), reply: None }) {
            tracing::warn!("push refused: too many requests are waiting");
        }
    })?;
    let to = Arc::clone(inbox);
    node.serve::<SetBool>("pause", move |request| {
        let (success, message) = flatten(ask(&to, Ask::Pause(request.data)));
        SetBoolResponse { success, message }
    })?;
    for (service, what) in [("reset", Ask::Reset), ("step", Ask::Step)] {
        let to = Arc::clone(inbox);
        node.serve::<Trigger>(service, move |_| {
            let (success, message) = flatten(ask(&to, what));
            TriggerResponse { success, message }
        })?;
    }
    Ok(())
}

/// Hands a request to the simulation's thread and waits for its answer.
pub(crate) fn ask(inbox: &Inbox, what: Ask) -> Result<String, String> {
    let (reply, answer) = channel();
    if !inbox.put_request(Request { ask: what, reply: Some(reply) }) {
        return Err("too many requests are waiting, or the simulation has ended".into());
    }
    answer.recv_timeout(SERVICE_PATIENCE).map_err(|_| "the simulation did not answer in time".to_owned())?
}

fn flatten(answer: Result<String, String>) -> (bool, String) {
    match answer {
        Ok(message) => (true, message),
        Err(message) => (false, message),
    }
}
