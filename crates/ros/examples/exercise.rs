//! A node with one of everything, for the tests against other ROS 2 implementations (`tests/ros2`).
//!
//! It echoes `input` on `output` (reliable) and `fast_input` on `fast_output` (best effort), keeps a latched
//! `description`, serves `count` (std_srvs/SetBool: answers after a delay given by a parameter), and calls the service
//! `remote` once when `relay` is called. Each call of `count` is a line of debugging, one with `false` an error.

use std::sync::Arc;
use std::time::Duration;

use ros::{Arguments, Node, Qos};
use tandem_msgs::sensor_msgs::JointState;
use tandem_msgs::std_msgs::String as Text;
use tandem_msgs::std_srvs::{SetBool, SetBoolRequest, SetBoolResponse, Trigger, TriggerResponse};
use tandem_msgs::{Gait, GenerateGait, GenerateGaitResponse, SolverReport};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (arguments, _) = Arguments::from_process()?;
    let node = Node::start("exercise", &arguments)?;
    let delay_ms =
        node.parameter("delay_ms", 0_i64).description("How long a response takes, ms.").range(0, 1000).declare()?;
    let _fixed = node.parameter("fixed", "as started".to_string()).read_only().declare()?;
    let _gain = node
        .parameter("gain", 1.0)
        .description("A number.")
        .range(0.0, 10.0)
        .validate("not 7", |value| if *value == 7.0 { Err("7 is taken".to_string()) } else { Ok(()) })
        .declare()?;
    let _names = node.parameter("group.names", vec!["a".to_string()]).declare()?;
    node.parameters_are_declared();

    let output = node.publisher::<Gait>("output", Qos::reliable(100))?;
    node.subscribe::<Gait>("input", Qos::reliable(100), move |message| {
        if let Err(error) = output.publish(message) {
            tracing::error!("{error}");
        }
    })?;
    let output = node.publisher::<JointState>("fast_output", Qos::best_effort(1))?;
    node.subscribe::<JointState>("fast_input", Qos::best_effort(1), move |message| {
        if let Err(error) = output.publish(message) {
            tracing::error!("{error}");
        }
    })?;
    let description = node.publisher::<Text>("description", Qos::latched())?;
    description.publish(Text { data: "a robot".to_string() })?;

    let mut calls = 0_u32;
    node.serve::<SetBool>("count", move |request| {
        std::thread::sleep(Duration::from_millis(delay_ms.get().unsigned_abs()));
        calls += 1;
        tracing::debug!("call {calls}");
        if !request.data {
            tracing::error!("call {calls} failed, as it was asked to");
        }
        SetBoolResponse { success: request.data, message: calls.to_string() }
    })?;
    node.serve::<GenerateGait>("generate", |request| GenerateGaitResponse {
        success: request.speed_m_s.value().is_ok(),
        status: request.behaviour,
        message: format!("{:?}", request.speed_m_s.0),
        step_duration_s: 0.25,
        solver: SolverReport { iterations: 7, ..SolverReport::default() },
        ..GenerateGaitResponse::default()
    })?;
    let remote = Arc::new(node.client::<SetBool>("remote")?);
    node.serve::<Trigger>("relay", move |_| {
        match remote.call(SetBoolRequest { data: true }, Duration::from_secs(8)) {
            Ok(response) => TriggerResponse::done(response.message),
            Err(error) => TriggerResponse::refused(error.to_string()),
        }
    })?;
    tracing::info!("ready");
    node.run();
    Ok(())
}
