//! The Rust messages as other ROS 2 implementations see them, for `tests/ros2/test_serialization.py`.
//!
//! Reads records from standard input: a line `TYPE LENGTH`, then as many bytes of CDR (with its four bytes of header). Decodes them
//! into the Rust type, encodes that again and writes a line with the new length and the bytes. `fields` as the only argument
//! prints the table of fields of every type as JSON instead.

use std::io::{BufRead, Read, Write};

use byteorder::LittleEndian;
use tandem_msgs::{
    Action, Claim, ClearFault, ControlCycle, ControllerState, Field, Gait, GenerateGait, GenerateGaitAction,
    JointCommand, JointDiagnostics, LoadGait, Message, Service, SolverReport, StartRecording, StopRecording,
    action_msgs, builtin_interfaces, diagnostic_msgs, geometry_msgs, lifecycle_msgs, nav_msgs, rcl_interfaces,
    rosgraph_msgs, sensor_msgs, std_msgs, std_srvs, unique_identifier_msgs, visualization_msgs,
};

/// Decodes and encodes again.
fn again<M: Message>(cdr: &[u8]) -> Result<Vec<u8>, String> {
    if cdr.get(..2) != Some(&[0, 1]) {
        return Err("expected little-endian CDR".to_string());
    }
    let (message, _) = cdr_encoding::from_bytes::<M, LittleEndian>(&cdr[4..]).map_err(|error| error.to_string())?;
    let body = cdr_encoding::to_vec::<M, LittleEndian>(&message).map_err(|error| error.to_string())?;
    Ok([&[0, 1, 0, 0], body.as_slice()].concat())
}

type Again = fn(&[u8]) -> Result<Vec<u8>, String>;

macro_rules! action {
    ($types:ident, $action:ty: $($part:ident),*) => { $( {
        type Part = <$action as Action>::$part;
        let name = format!("{}/action/{}.{}", <$action>::PACKAGE, <$action>::NAME, stringify!($part));
        $types.push((name, Part::fields(), again::<Part>));
    } )* };
}

/// Every type: its name as rclpy's modules have it, its fields, its two-way conversion.
fn types() -> Vec<(String, Vec<Field>, Again)> {
    let mut types: Vec<(String, Vec<Field>, Again)> = Vec::new();
    macro_rules! messages {
        ($($type:ty),* $(,)?) => { $(
            types.push((<$type as Message>::full_name(), <$type as Message>::fields(), again::<$type>));
        )* };
    }
    macro_rules! services {
        ($($service:ty),* $(,)?) => { $(
            let name = format!("{}/srv/{}", <$service as Service>::PACKAGE, <$service as Service>::NAME);
            type Request = <$service as Service>::Request;
            type Response = <$service as Service>::Response;
            types.push((format!("{name}.Request"), Request::fields(), again::<Request>));
            types.push((format!("{name}.Response"), Response::fields(), again::<Response>));
        )* };
    }
    macro_rules! service_list {
        ($($service:ty),* $(,)?) => { $( { services!($service); } )* };
    }
    messages!(
        builtin_interfaces::Time,
        builtin_interfaces::Duration,
        std_msgs::Header,
        std_msgs::Bool,
        std_msgs::String,
        std_msgs::Float64,
        std_msgs::ColorRGBA,
        geometry_msgs::Vector3,
        geometry_msgs::Point,
        geometry_msgs::Quaternion,
        geometry_msgs::Pose,
        geometry_msgs::PoseStamped,
        geometry_msgs::Twist,
        geometry_msgs::TwistStamped,
        geometry_msgs::Wrench,
        geometry_msgs::WrenchStamped,
        geometry_msgs::PoseWithCovariance,
        geometry_msgs::TwistWithCovariance,
        geometry_msgs::Transform,
        geometry_msgs::TransformStamped,
        sensor_msgs::JointState,
        sensor_msgs::Imu,
        sensor_msgs::BatteryState,
        sensor_msgs::CompressedImage,
        nav_msgs::Odometry,
        rosgraph_msgs::Clock,
        diagnostic_msgs::DiagnosticArray,
        diagnostic_msgs::DiagnosticStatus,
        diagnostic_msgs::KeyValue,
        unique_identifier_msgs::UUID,
        rcl_interfaces::Log,
        rcl_interfaces::ParameterValue,
        rcl_interfaces::Parameter,
        rcl_interfaces::ParameterDescriptor,
        rcl_interfaces::ParameterEvent,
        rcl_interfaces::FloatingPointRange,
        rcl_interfaces::IntegerRange,
        rcl_interfaces::SetParametersResult,
        rcl_interfaces::ListParametersResult,
        visualization_msgs::UVCoordinate,
        visualization_msgs::MeshFile,
        visualization_msgs::Marker,
        visualization_msgs::MarkerArray,
        ControlCycle,
        lifecycle_msgs::State,
        lifecycle_msgs::Transition,
        lifecycle_msgs::TransitionDescription,
        lifecycle_msgs::TransitionEvent,
        action_msgs::GoalInfo,
        action_msgs::GoalStatus,
        action_msgs::GoalStatusArray,
        JointCommand,
        JointDiagnostics,
        SolverReport,
        Gait,
        ControllerState,
    );
    service_list!(
        std_srvs::Trigger,
        std_srvs::SetBool,
        rcl_interfaces::ListParameters,
        rcl_interfaces::GetParameters,
        rcl_interfaces::GetParameterTypes,
        rcl_interfaces::SetParameters,
        rcl_interfaces::SetParametersAtomically,
        rcl_interfaces::DescribeParameters,
        lifecycle_msgs::GetState,
        lifecycle_msgs::ChangeState,
        lifecycle_msgs::GetAvailableStates,
        lifecycle_msgs::GetAvailableTransitions,
        GenerateGait,
        LoadGait,
        StartRecording,
        StopRecording,
        Claim,
        ClearFault,
    );
    action!(types, GenerateGaitAction: Goal, Result, Feedback);
    types
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let types = types();
    let mut output = std::io::stdout().lock();
    if std::env::args().nth(1).as_deref() == Some("fields") {
        for (name, fields, _) in &types {
            let fields: Vec<String> =
                fields.iter().map(|field| format!("{}={}", field.name, field.type_name)).collect();
            writeln!(output, "{name} {}", fields.join(" "))?;
        }
        return Ok(());
    }
    let mut input = std::io::stdin().lock();
    let mut line = String::new();
    while input.read_line(&mut line)? > 0 {
        let (name, length) = line.trim().split_once(' ').ok_or("expected TYPE LENGTH")?;
        let mut cdr = vec![0; length.parse()?];
        input.read_exact(&mut cdr)?;
        let (.., again) =
            types.iter().find(|(known, ..)| known == name).ok_or_else(|| format!("{name} is not known"))?;
        let bytes = again(&cdr).map_err(|error| format!("{name}: {error}"))?;
        writeln!(output, "{}", bytes.len())?;
        output.write_all(&bytes)?;
        output.flush()?;
        line.clear();
    }
    Ok(())
}
