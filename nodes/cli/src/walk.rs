//! `tandem walk`: a client of the three nodes. It asks for gaits, lets the robot walk them, watches, records and
//! reports.

mod recorded;
mod summary;
mod walked;
mod watch;

use crate::output;
use crate::robots::RobotArguments;
use anyhow::{Context, Result, bail};
use gait::Gait;
use robot::Robot;
use ros::{Client, Node};
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};
use summary::summary;
use tandem_msgs::std_srvs::{Trigger, TriggerRequest};
use tandem_msgs::text::{SENTENCE_CHARS, printable};
use tandem_msgs::{
    GenerateGait, GenerateGaitRequest, GenerateGaitResponse, StartRecording, StartRecordingRequest, StopRecording,
    StopRecordingRequest,
};
use walked::Walked;
use watch::{Outcome, Watch};

/// A service's answer is waited for so long; a plan may take the planner's own time limit.
const SERVICE_PATIENCE: Duration = Duration::from_secs(10);
const RECORDING_PATIENCE: Duration = Duration::from_secs(30);
const PLAN_PATIENCE: Duration = Duration::from_secs(60);
/// Wall time in which a change of mode must come.
const MODE_PATIENCE: Duration = Duration::from_secs(40);
/// Wall time in which a robot that was put down must come to rest.
const REST_PATIENCE: Duration = Duration::from_secs(10);
/// Wall time without a joint state after which the robot counts as gone.
const SILENCE: Duration = Duration::from_secs(10);

/// Ask the running nodes for gaits and walk them, with a record of everything
///
/// For each gait: calls the planner's service generate_gait, puts the robot down, arms it, lets it stand, walk for the
/// time given, stop and sit, has the controller record all of it into a rosbag2 bag, and writes the gait file, phase
/// portraits, torques, time series, footfalls and tiles of a step. Then prints what came out beside the paper's Table
/// II. Ends with an error code if the robot fell. The planner, the controller and the simulation bridge must run in the
/// same ROS domain and namespace: launch-scripts/demo starts all of them.
///
///   tandem walk gait1 amble --seconds 20 --out out/demo
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    /// gait1, gait2, gait3, gait4 or amble
    #[arg(required = true, value_name = "GAIT")]
    gaits: Vec<String>,
    /// Walking time of each gait, s of the robot's time
    #[arg(long, value_name = "S", default_value_t = 20.0)]
    seconds: f64,
    /// Folder for files, one folder in it for each gait
    #[arg(long, value_name = "FOLDER", value_parser = output::folder)]
    out: PathBuf,
    /// Print one JSON object for each gait on standard output, and what goes on on standard error
    #[arg(long)]
    json: bool,
    /// Namespace of the nodes
    #[arg(long, default_value = "/")]
    namespace: String,
    #[command(flatten)]
    robot: RobotArguments,
}

/// Runs the subcommand.
pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    if !(1.0..=36_000.0).contains(&arguments.seconds) {
        bail!("--seconds is {}, expected 1 to 36000", arguments.seconds);
    }
    let robot = arguments.robot.load()?;
    if arguments.json {
        output::divert();
    }
    std::fs::create_dir_all(&arguments.out)
        .with_context(|| format!("cannot make the folder {}", arguments.out.display()))?;
    let remap = format!("__ns:={}", arguments.namespace);
    let (ros_arguments, _) = ros::Arguments::from_line(["tandem", "--ros-args", "-r", &remap].map(String::from))?;
    let node = Node::start("tandem_walk", &ros_arguments)?;
    let session = Session::new(&node, &robot)?;
    let mut done = Vec::new();
    for name in &arguments.gaits {
        match session.walk(name, arguments.seconds, &arguments.out.join(name)) {
            Ok(walked) => done.push(walked),
            // The gaits before are still reported.
            Err(error) => {
                // Leaves in order; a robot that walks is asked to stop, also where nobody reads on.
                session.leave();
                arguments.print_summary(&robot, &done)?;
                return Err(error.context(name.clone()));
            }
        }
    }
    let text = summary(&robot, &done);
    write(&arguments.out.join("summary.txt"), text.as_bytes())?;
    let json = serde_json::to_string_pretty(&done.iter().map(Walked::json).collect::<Vec<_>>())? + "\n";
    write(&arguments.out.join("summary.json"), json.as_bytes())?;
    node.shutdown();
    arguments.print_summary(&robot, &done)?;
    if !arguments.json {
        say!("\nfiles are in {}", arguments.out.display())?;
    }
    Ok(if done.iter().all(|walked| walked.outcome.upright()) { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

impl Arguments {
    fn print_summary(&self, robot: &Robot, done: &[Walked]) -> Result<()> {
        if self.json {
            done.iter().try_for_each(|walked| output::document(&walked.json()))?;
        } else {
            output::part(format_args!("{}", summary(robot, done)))?;
        }
        Ok(())
    }
}

/// The clients of the nodes' services, and the subscriptions to their topics.
struct Session<'a> {
    node: &'a Node,
    robot: &'a Robot,
    watch: Watch,
    generate: Client<GenerateGait>,
    start_recording: Client<StartRecording>,
    stop_recording: Client<StopRecording>,
    triggers: Vec<Client<Trigger>>,
}

const TRIGGERS: [&str; 7] = ["reset", "arm", "stand", "walk", "stop", "sit", "disarm"];

impl<'a> Session<'a> {
    fn new(node: &'a Node, robot: &'a Robot) -> Result<Self> {
        Ok(Self {
            node,
            robot,
            watch: Watch::new(node, robot)?,
            generate: node.client("generate_gait")?,
            start_recording: node.client("start_recording")?,
            stop_recording: node.client("stop_recording")?,
            triggers: TRIGGERS.iter().map(|service| node.client(service)).collect::<Result<_, _>>()?,
        })
    }

    /// Calls one of the services without arguments; a refusal is an error.
    fn trigger(&self, service: &str) -> Result<()> {
        let index = TRIGGERS.iter().position(|name| *name == service).expect("one of the list");
        let response = self.triggers[index].call(TriggerRequest::default(), SERVICE_PATIENCE)?;
        if !response.success {
            bail!("{service} was refused: {}", response.message);
        }
        Ok(())
    }

    /// Arms the robot, once it has come to rest where it was put down.
    fn arm(&self) -> Result<()> {
        let deadline = Instant::now() + REST_PATIENCE;
        while let Err(refusal) = self.trigger("arm") {
            self.check_for_end()?;
            if Instant::now() >= deadline {
                return Err(refusal);
            }
            std::thread::sleep(Duration::from_millis(200));
        }
        Ok(())
    }

    /// Waits for a mode of the controller. A fault, a fall and silence end the waiting with an error.
    fn wait_for_mode(&self, mode: &str) -> Result<()> {
        let deadline = Instant::now() + MODE_PATIENCE;
        loop {
            self.check_for_end()?;
            let state = self.watch.controller();
            if state.as_ref().is_some_and(|state| state.mode == mode) {
                return Ok(());
            }
            // After arming the robot damps until it is asked to stand; damping for any other reason is an end.
            if let Some(state) = &state
                && (state.mode == "fault" || (state.mode == "damping" && state.fault != "armed"))
            {
                bail!("the controller stopped: {} ({})", state.fault, state.mode);
            }
            if Instant::now() >= deadline {
                let now = state.map_or("nothing was received of it".into(), |state| format!("it is {}", state.mode));
                bail!("the controller was not {mode} within {} s: {now}", MODE_PATIENCE.as_secs());
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    fn check_for_end(&self) -> Result<()> {
        if self.node.stop().is_requested() {
            bail!("interrupted");
        }
        if let Some(silent) = self.watch.silence()
            && silent > SILENCE
        {
            bail!("no joint state for {silent:.1?}: is the simulation (or the robot) still running?");
        }
        Ok(())
    }

    /// The gait that an answer of the planner stands for: it comes on the topic `gait`.
    fn published(&self, response: &GenerateGaitResponse) -> Result<tandem_msgs::Gait> {
        let since = Instant::now();
        loop {
            if let Some(gait) = self.watch.gait()
                && gait.header.stamp == response.gait_stamp
            {
                return Ok(gait);
            }
            if since.elapsed() > SERVICE_PATIENCE {
                bail!("the planner answered, but its gait did not come on the topic gait within {SERVICE_PATIENCE:?}");
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Asks a walking robot to stop; says nothing if nobody listens any more.
    fn leave(&self) {
        if self.watch.controller().is_some_and(|state| state.mode == "walking") {
            let stop = TRIGGERS.iter().position(|name| *name == "stop").expect("one of the list");
            let _ = self.triggers[stop].call(TriggerRequest::default(), Duration::from_secs(1));
        }
    }

    fn walk(&self, name: &str, seconds: f64, folder: &Path) -> Result<Walked> {
        say!("{name}: asking the planner")?;
        let asked = Instant::now();
        let request = GenerateGaitRequest { behaviour: name.into(), ..Default::default() };
        let response = self.generate.call(request, PLAN_PATIENCE)?;
        if !response.success {
            bail!("no gait: {}: {}", response.status, response.message);
        }
        let gait = self.published(&response)?.to_gait()?;
        say!(
            "{name}: planned in {:.3} s and {} iterations (answer after {:.3} s)",
            gait.solver.solve_time_s,
            gait.solver.iterations,
            asked.elapsed().as_secs_f64()
        )?;
        if folder.exists() {
            std::fs::remove_dir_all(folder).with_context(|| format!("cannot replace {}", folder.display()))?;
        }
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
        write(&folder.join("gait.json"), gait.to_json().as_bytes())?;

        self.trigger("reset")?;
        let request = StartRecordingRequest { folder: recorded::name(name)? };
        let started = self.start_recording.call(request, RECORDING_PATIENCE)?;
        if !started.success {
            bail!("the controller does not record: {}", started.message);
        }
        let walked = self.walk_recorded(name, seconds, folder, gait);
        if walked.is_err() {
            // The recording holds most of what went wrong. Its own error would hide the first.
            let _ = self.stop_recording.call(StopRecordingRequest::default(), RECORDING_PATIENCE);
        }
        walked
    }

    /// The walk while the controller records.
    fn walk_recorded(&self, name: &str, seconds: f64, folder: &Path, gait: Gait) -> Result<Walked> {
        self.watch.begin(&gait);
        self.arm()?;
        say!("{name}: standing up")?;
        self.trigger("stand")?;
        self.wait_for_mode("standing")?;
        let loaded = self.watch.controller().map(|state| state.gait).unwrap_or_default();
        if loaded != gait.name {
            bail!("the controller has the gait {loaded:?}, expected {:?}: see its log", gait.name);
        }
        self.trigger("walk")?;
        self.wait_for_mode("walking")?;
        let outcome = self.walk_on(name, seconds)?;
        if outcome.upright() {
            say!("{}{name}: stopping and sitting down          ", over())?;
            self.trigger("stop")?;
            self.wait_for_mode("standing")?;
            self.trigger("sit")?;
            self.wait_for_mode("disarmed").or_else(|_| self.trigger("disarm"))?;
        } else {
            say!("{}{name}: {}          ", over(), printable(&outcome.to_string(), SENTENCE_CHARS))?;
        }
        let recorded = self.watch.end()?;
        let bag = self.stop_recording.call(StopRecordingRequest::default(), RECORDING_PATIENCE)?;
        let mut problems = Vec::new();
        if !bag.success {
            problems.push(format!("the recording failed: {}", bag.message));
        } else if let Err(problem) = recorded::fetch(Path::new(&bag.folder), &folder.join("bag")) {
            problems.push(format!("the bag stays in {} on the controller's machine: {problem:#}", bag.folder));
        }
        let mut walked = Walked {
            figures: recorded.figures,
            outcome,
            controller: recorded.controller,
            lost_states: recorded.lost_states,
            bag,
            problems,
            gait,
        };
        say!("{name}: drawing")?;
        walked.draw(self.robot, folder, &recorded.samples, recorded.walking_from_s)?;
        // What was found about the fall is cleared with the next arming; faults stay until they are cleared by name.
        Ok(walked)
    }

    /// Watches until the time is over or the robot has fallen.
    fn walk_on(&self, name: &str, seconds: f64) -> Result<Outcome> {
        let mut shown = 0;
        loop {
            self.check_for_end()?;
            if let Some(outcome) = self.watch.outcome(seconds) {
                return Ok(outcome);
            }
            let walked = self.watch.walked_s();
            if walked as u64 > shown {
                shown = walked as u64;
                if std::io::stdout().is_terminal() {
                    output::part(format_args!("\r{name}: walking, {shown} of {seconds:.0} s "))?;
                }
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

/// At a terminal the line of the time walked is written over.
fn over() -> &'static str {
    if std::io::stdout().is_terminal() { "\r" } else { "" }
}

fn write(file: &Path, bytes: &[u8]) -> Result<()> {
    output::write_file(file, bytes)
}
