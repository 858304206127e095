//! The Rust messages as other ROS 2 implementations see them, for `tests/ros2/test_serialization.py`.
//!
//! Reads records from standard input: a line `TYPE LENGTH`, then as many bytes of CDR (with its four bytes of header).
//! Decodes them into the Rust type, encodes that again and writes a line with the new length and the bytes. `fields` as
//! the only argument prints the table of fields of every type as JSON instead.

use std::io::{BufRead, Read, Write};

use byteorder::LittleEndian;
use tandem_msgs::{
    Action, Claim, ClearFault, ControlCycle, ControllerState, Field, FootContacts, Gait, GaitDomain, GenerateGait,
    GenerateGaitAction, JointCommand, JointDiagnostics, LoadGait, Message, Service, SolverReport, StartRecording,
    StopRecording, TypeHash, action_msgs, builtin_interfaces, diagnostic_msgs, geometry_msgs, lifecycle_msgs, nav_msgs,
    rcl_interfaces, rosgraph_msgs, sensor_msgs, std_msgs, std_srvs, unique_identifier_msgs, visualization_msgs,
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

/// A type: its name as rclpy's modules have it, its fields, its two-way conversion.
type Type = (String, Vec<Field>, Again);

/// What all types are, and their hashes.
#[derive(Default)]
struct Types {
    types: Vec<Type>,
    hashes: Vec<TypeHash>,
}

impl Types {
    fn message<M: Message>(&mut self) {
        self.types.push((M::full_name(), M::fields(), again::<M>));
        self.hashes.push(TypeHash::of_message::<M>());
    }

    fn service<S: Service>(&mut self) {
        let name = format!("{}/srv/{}", S::PACKAGE, S::NAME);
        self.types.push((format!("{name}.Request"), S::Request::fields(), again::<S::Request>));
        self.types.push((format!("{name}.Response"), S::Response::fields(), again::<S::Response>));
        self.hashes.extend(TypeHash::of_service::<S>());
    }

    fn action<A: Action>(&mut self) {
        let name = format!("{}/action/{}", A::PACKAGE, A::NAME);
        self.types.push((format!("{name}.Goal"), A::Goal::fields(), again::<A::Goal>));
        self.types.push((format!("{name}.Result"), A::Result::fields(), again::<A::Result>));
        self.types.push((format!("{name}.Feedback"), A::Feedback::fields(), again::<A::Feedback>));
        self.hashes.extend(TypeHash::of_action::<A>());
    }
}

macro_rules! messages {
    ($types:ident: $($type:ty),* $(,)?) => { $( $types.message::<$type>(); )* };
}
macro_rules! services {
    ($types:ident: $($service:ty),* $(,)?) => { $( $types.service::<$service>(); )* };
}

/// Every type.
fn types() -> Types {
    let mut types = Types::default();
    messages!(types:
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
        lifecycle_msgs::State,
        lifecycle_msgs::Transition,
        lifecycle_msgs::TransitionDescription,
        lifecycle_msgs::TransitionEvent,
        action_msgs::GoalInfo,
        action_msgs::GoalStatus,
        action_msgs::GoalStatusArray,
    );
    own_messages(&mut types);
    services!(types:
        std_srvs::Trigger,
        std_srvs::SetBool,
        action_msgs::CancelGoal,
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
    types.action::<GenerateGaitAction>();
    types
}

fn own_messages(types: &mut Types) {
    messages!(types:
        ControlCycle,
        FootContacts,
        JointCommand,
        JointDiagnostics,
        SolverReport,
        Gait,
        GaitDomain,
        ControllerState,
    );
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let Types { types, hashes } = types();
    let mut output = std::io::stdout().lock();
    if std::env::args().nth(1).as_deref() == Some("hashes") {
        for TypeHash { name, hash } in &hashes {
            writeln!(output, "{name} {hash}")?;
        }
        return Ok(());
    }
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
