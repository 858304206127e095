//! Running a recorded run again.

use std::path::Path;
use std::time::Duration;

use bag::{Bag, from_cdr};
use control::{
    Config, Controller, Fault, FaultReport, Input, JOINTS, Output, PreparedGait, Request, Snapshot, SnapshotVersion1,
    Velocity,
};
use gait::Gait;
use run_recorder::names::{self, request_of};
use tandem_msgs::sensor_msgs::JointState;
use tandem_msgs::{ControlCycle, JointCommand};

use crate::ReplayError;
use crate::cycle::{before, body_pose, control_cycle, inertial_state, velocity_command};

/// A command that came out differently.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// The controller's cycle, from 1.
    pub cycle: u64,
    /// When, s since the bag's first message.
    pub time_s: f64,
    /// The joint's name; empty where the mode differs.
    pub joint: String,
    /// Which value: position, velocity, kp, kd, torque, or mode.
    pub what: &'static str,
    /// As recorded.
    pub recorded: String,
    /// As computed now.
    pub computed: String,
}

/// What running a bag again showed.
#[derive(Clone, Debug, PartialEq)]
pub struct Verification {
    /// Cycles that were run again.
    pub cycles: u64,
    /// Time from the first to the last, s.
    pub duration_s: f64,
    /// Cycles whose command or mode differs.
    pub different: u64,
    /// The first difference.
    pub first: Option<Difference>,
}

/// Runs every recorded cycle through a new controller and compares commands and modes to the bit.
///
/// # Errors
/// [`ReplayError::NoRun`] if the bag lacks the configuration or a cycle (dropped by the recorder, or not recorded from
/// the start), or its configuration or gait is not one for this version; [`ReplayError::BadMessage`].
pub fn verify(path: impl AsRef<Path>) -> Result<Verification, ReplayError> {
    follow(path.as_ref(), &mut |_, _| ())
}

/// The same, in the eyes of one who watches: `observe` sees each cycle's time (s since the bag's first message) and
/// what came of it.
pub(crate) fn follow(path: &Path, observe: &mut dyn FnMut(f64, &Followed)) -> Result<Verification, ReplayError> {
    let bag = Bag::open(path)?;
    let no_run = |problem: String| ReplayError::NoRun { path: path.to_owned(), problem };
    let index_of = |name: &str| {
        let found = bag.topics().iter().position(|topic| names::is(&topic.name, name) && topic.messages > 0);
        found.ok_or_else(|| {
            no_run(format!(
                "there is no message on '{name}'; expected a run recorded whole by the controller or by 'tandem simulate'"
            ))
        })
    };
    let cycles_topic = index_of(names::CONTROL_CYCLE)?;
    let config_topic = index_of(names::CONTROLLER_CONFIG)?;
    let command_topic = index_of(names::JOINT_COMMAND)?;
    let snapshot_topic = bag.topics().iter().position(|topic| names::is(&topic.name, names::CONTROLLER_SNAPSHOT));
    let states_topic = bag.topics().iter().position(|topic| names::is(&topic.name, names::JOINT_STATES));
    let gait_topic = bag.topics().iter().position(|topic| names::is(&topic.name, names::GAIT_FILE));

    let start_ns = bag.span_ns().map_or(0, |(start, _)| start);
    let mut player = Player::default();
    let mut result = Verification { cycles: 0, duration_s: 0.0, different: 0, first: None };
    let mut first_ns = None;
    for message in bag.messages()? {
        let message = message?;
        let topic = &bag.topics()[message.topic];
        let time_s = (message.stamp_ns - start_ns) as f64 * 1e-9;
        let bad = |problem: String| ReplayError::BadMessage {
            path: path.to_owned(),
            topic: topic.name.clone(),
            time_s,
            problem,
        };
        let data = &message.data;
        if message.topic == config_topic {
            let text: tandem_msgs::std_msgs::String = from_cdr(&topic.type_name, data)?;
            let config: Config = serde_json::from_str(&text.data)
                .map_err(|error| no_run(format!("its controller configuration is not one of this version: {error}")))?;
            let controller = Controller::new(config.clone())
                .map_err(|error| no_run(format!("its controller configuration: {error}")))?;
            player.controller = Some((controller, config));
        } else if Some(message.topic) == snapshot_topic {
            let text: tandem_msgs::std_msgs::String = from_cdr(&topic.type_name, data)?;
            player.resume(&text.data).map_err(bad)?;
        } else if Some(message.topic) == gait_topic {
            let text: tandem_msgs::std_msgs::String = from_cdr(&topic.type_name, data)?;
            let gait = Gait::from_json(&text.data).map_err(|error| no_run(error.to_string()))?;
            player.gaits.push(gait);
        } else if Some(message.topic) == states_topic {
            player.state = Some(from_cdr(&topic.type_name, data)?);
        } else if message.topic == command_topic {
            player.commands.push(from_cdr(&topic.type_name, data)?);
        } else if message.topic == cycles_topic {
            let cycle = control_cycle(topic, data)?;
            let (followed, difference) = player.cycle(&cycle, time_s).map_err(bad)?;
            observe(time_s, &followed);
            result.cycles += 1;
            result.duration_s = (message.stamp_ns - *first_ns.get_or_insert(message.stamp_ns)) as f64 * 1e-9;
            if let Some(difference) = difference {
                result.different += 1;
                result.first.get_or_insert(difference);
            }
        }
    }
    Ok(result)
}

/// A cycle that was run again.
pub(crate) struct Followed {
    /// What the controller's step reported.
    pub output: Output,
    /// The velocity that was asked for, as old as it was.
    pub asked: Option<Velocity>,
}

#[derive(Default)]
struct Player {
    controller: Option<(Controller, Config)>,
    gaits: Vec<Gait>,
    state: Option<JointState>,
    commands: Vec<JointCommand>,
    /// What the last cycle saw of the inertial unit.
    inertial: Option<control::InertialState>,
    /// What velocity the last cycle was asked for.
    velocity: Option<control::VelocityCommand>,
    last_index: u64,
    /// A cycle was run, or the recording says where it began.
    begun: bool,
}

impl Player {
    /// Goes on from where the controller was when the recording began.
    fn resume(&mut self, text: &str) -> Result<(), String> {
        let (controller, config) =
            self.controller.as_mut().ok_or("it comes before the controller's configuration, expected after it")?;
        if self.begun {
            return Err("it comes in the middle of the recording, expected before the first cycle".into());
        }
        let snapshot = read_snapshot(text)?;
        *controller = Controller::resume(config.clone(), &snapshot).map_err(|error| error.to_string())?;
        self.last_index = snapshot.cycles();
        self.begun = true;
        Ok(())
    }

    /// Runs one cycle; the error is the recording's.
    fn cycle(&mut self, cycle: &ControlCycle, time_s: f64) -> Result<(Followed, Option<Difference>), String> {
        let (controller, config) =
            self.controller.as_mut().ok_or("a cycle before the controller's configuration was recorded")?;
        if cycle.index != self.last_index + 1 {
            return Err(format!(
                "cycle {} follows cycle {}: {}",
                cycle.index,
                self.last_index,
                if !self.begun {
                    "the recording does not begin with the controller's first cycle"
                } else {
                    "the recorder dropped what lies between"
                }
            ));
        }
        self.last_index = cycle.index;
        self.begun = true;
        let commands = std::mem::take(&mut self.commands);
        let [recorded] = commands.as_slice() else {
            return Err(format!(
                "{} commands belong to this cycle; expected 1 (the recorder dropped some)",
                commands.len()
            ));
        };
        let joints = match (cycle.state_seen, &self.state) {
            (false, _) => None,
            (true, Some(state)) => Some(joint_state(cycle, state)?),
            (true, None) => return Err("its joint state was not recorded".into()),
        };
        let requests: Vec<Request> = cycle
            .requests
            .iter()
            .map(|word| request_of(word).ok_or_else(|| format!("request '{word}' is not known to this version")))
            .collect::<Result<_, String>>()?;
        let gait = match cycle.gait {
            0 => None,
            number => {
                let gait = self
                    .gaits
                    .get(number as usize - 1)
                    .ok_or_else(|| format!("gait file {number} was not recorded"))?;
                Some(PreparedGait::new(gait, config).map_err(|error| error.to_string())?)
            }
        };
        (self.inertial, self.velocity) =
            (inertial_state(cycle, self.inertial)?, velocity_command(cycle, self.velocity)?);
        let fault = if cycle.fault.is_empty() {
            None
        } else {
            let fault = Fault::from_name(&cycle.fault)
                .ok_or_else(|| format!("fault '{}' is not known to this version", cycle.fault))?;
            let joint = usize::try_from(cycle.fault_joint).ok();
            Some(FaultReport { fault, joint, value: cycle.fault_value, limit: cycle.fault_limit })
        };
        let input = Input {
            joints: joints.as_ref(),
            inertial: self.inertial,
            velocity: self.velocity,
            body_pose: body_pose(cycle)?,
            requests: &requests,
            gait: gait.as_ref(),
            emergency_stop: cycle.emergency_stop,
            fault,
        };
        let now = before(cycle, 0)?;
        let output = controller.step(&input, now);
        let timeout_s = config.balance.as_ref().map_or(f64::INFINITY, |balance| balance.command_timeout_s);
        let asked = self.velocity.map(|command| command.at(now, timeout_s));
        let difference = difference(cycle, recorded, &output, config, time_s)?;
        Ok((Followed { output, asked }, difference))
    }
}

/// What of a cycle's command and mode came out otherwise than recorded, if anything did.
fn difference(
    cycle: &ControlCycle,
    recorded: &JointCommand,
    output: &Output,
    config: &Config,
    time_s: f64,
) -> Result<Option<Difference>, String> {
    let computed = &output.command;
    let found = |joint: usize, what: &'static str, recorded: f64, computed: f64| Difference {
        cycle: cycle.index,
        time_s,
        joint: config.joint_names[joint].clone(),
        what,
        recorded: exact(recorded),
        computed: exact(computed),
    };
    let pairs: [(&'static str, &[f64], &[f64; JOINTS]); 5] = [
        ("position", &recorded.position, &computed.position_rad),
        ("velocity", &recorded.velocity, &computed.velocity_rad_s),
        ("kp", &recorded.kp, &computed.kp),
        ("kd", &recorded.kd, &computed.kd),
        ("torque", &recorded.torque, &computed.torque_nm),
    ];
    for (what, recorded, computed) in pairs {
        if recorded.len() != JOINTS {
            return Err(format!("the command's {what} has {} entries; expected {JOINTS}", recorded.len()));
        }
        for joint in 0..JOINTS {
            if recorded[joint].to_bits() != computed[joint].to_bits() {
                return Ok(Some(found(joint, what, recorded[joint], computed[joint])));
            }
        }
    }
    if cycle.mode != output.mode.name() {
        return Ok(Some(Difference {
            cycle: cycle.index,
            time_s,
            joint: String::new(),
            what: "mode",
            recorded: cycle.mode.clone(),
            computed: output.mode.name().into(),
        }));
    }
    Ok(None)
}

/// A controller's memory in today's form, or in that of versions before it was split.
fn read_snapshot(text: &str) -> Result<Snapshot, String> {
    serde_json::from_str(text).or_else(|error| {
        serde_json::from_str::<SnapshotVersion1>(text)
            .map(Snapshot::from)
            .map_err(|_| format!("the controller's memory is not one of this version: {error}"))
    })
}

/// A number with its bits, because two that differ in the last bit print alike otherwise.
fn exact(value: f64) -> String {
    format!("{value:?} (bits {:016x})", value.to_bits())
}

fn joint_state(cycle: &ControlCycle, state: &JointState) -> Result<control::JointState, String> {
    let before = |age_ns| before(cycle, age_ns);
    let stamp = &state.header.stamp;
    let stamp =
        Duration::new(u64::try_from(stamp.sec).map_err(|_| "a joint state with a negative time")?, stamp.nanosec);
    let seen = before(cycle.state_age_ns)?;
    if stamp != seen {
        return Err(format!(
            "it saw the joint state stamped {} ns; the one recorded last is stamped {} ns (the recorder dropped some)",
            seen.as_nanos(),
            stamp.as_nanos()
        ));
    }
    Ok(control::JointState {
        stamp,
        arrived: {
            let ages_ns: [i64; JOINTS] = match cycle.state_arrival_age_ns.as_slice() {
                [all] => [*all; JOINTS],
                each => array("state_arrival_age_ns", each)?,
            };
            let mut arrived = [Duration::ZERO; JOINTS];
            for (arrived, age_ns) in arrived.iter_mut().zip(ages_ns) {
                *arrived = before(age_ns)?;
            }
            arrived
        },
        position_rad: array("position", &state.position)?,
        velocity_rad_s: array("velocity", &state.velocity)?,
        temperature_c: match cycle.state_temperature_c.as_slice() {
            [] => None,
            values => Some(array("state_temperature_c", values)?),
        },
        drive_error: match cycle.state_drive_error.as_slice() {
            [] => [0; JOINTS],
            values => array("state_drive_error", values)?,
        },
    })
}

fn array<T: Copy, const N: usize>(name: &str, values: &[T]) -> Result<[T; N], String> {
    values.try_into().map_err(|_| format!("{name} has {} entries; expected {N}", values.len()))
}
