//! Stand up, plan an amble, walk twenty steps of it, stop and sit down. Run it beside the three nodes; needs no ROS 2.

use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use ros::{Arguments, Node, Qos};
use tandem_msgs::std_srvs::{Trigger, TriggerRequest};
use tandem_msgs::{ControllerState, GenerateGait, GenerateGaitRequest};

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// A change of mode takes some seconds; a busy machine may need more.
const PATIENCE: Duration = Duration::from_secs(60);

fn main() -> Outcome<()> {
    let (arguments, _) = Arguments::from_process()?;
    let node = Node::start("first_walk", &arguments)?;
    let (sender, states) = channel();
    node.subscribe("controller_state", Qos::reliable(10), move |state: ControllerState| {
        let _ = sender.send(state); // fails only once the walk below has ended
    })?;

    trigger(&node, "arm")?;
    trigger(&node, "stand")?;
    let request = GenerateGaitRequest { behaviour: "amble".into(), ..GenerateGaitRequest::default() };
    let plan = node.client::<GenerateGait>("generate_gait")?.call(request, PATIENCE)?;
    if !plan.success {
        return Err(plan.message.into());
    }
    wait(&states, |state| state.mode == "standing" && state.gait == plan.gait)?;
    trigger(&node, "walk")?;
    wait(&states, |state| state.step_index >= 20)?;
    trigger(&node, "stop")?;
    wait(&states, |state| state.mode == "standing")?;
    trigger(&node, "sit")?;
    wait(&states, |state| state.mode == "disarmed")?;
    node.shutdown();
    Ok(())
}

/// Calls a service without fields; what it refuses is an error.
fn trigger(node: &Node, service: &str) -> Outcome<()> {
    let answer = node.client::<Trigger>(service)?.call(TriggerRequest::default(), PATIENCE)?;
    println!("{service}: {}", answer.message);
    if answer.success { Ok(()) } else { Err(answer.message.into()) }
}

/// Waits for a state; a fault on the way is an error.
fn wait(states: &Receiver<ControllerState>, reached: impl Fn(&ControllerState) -> bool) -> Outcome<()> {
    loop {
        let state = states.recv_timeout(PATIENCE)?;
        if reached(&state) {
            return Ok(());
        }
        if state.mode == "fault" {
            return Err(format!("fault: {}", state.fault).into());
        }
    }
}
