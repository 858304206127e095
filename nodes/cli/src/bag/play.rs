//! `tandem bag play`: a recording is published with its own timing.

use super::controls::{Control, controls};
use super::offers::{Offered, overrides};
use ::bag::{Bag, Message, Messages};
use anyhow::{Result, bail};
use ros::{Node, PublishError, Qos};
use std::collections::VecDeque;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::mpsc::{Receiver, TryRecvError};
use std::time::{Duration, Instant};
use tandem_msgs::builtin_interfaces::Time;
use tandem_msgs::rosgraph_msgs::Clock;

/// Publish a recording with its own timing
///
/// Topics are offered so that every subscriber is served who was served while they were recorded, also where several
/// publishers offered different qualities of service. Messages on latched topics (gait, robot_description) from before
/// the start are sent first, also when it begins again and after a seek: all that late subscribers would have got.
///
/// While it plays, lines on standard input control it: `pause`, `resume`, `seek SECONDS`, `rate FACTOR`, `quit`; the
/// service `bag_player/pause` (std_srvs/SetBool) pauses and resumes.
///
///   tandem bag play out/run --rate 0.5 --start 3 --loop
///   tandem bag play out/run --topic /joint_states --topic /odom --clock
///   tandem bag play out/run --ros-args -r /joint_states:=/replayed/joint_states
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    /// A bag's folder, or one .mcap or .db3 file
    bag: PathBuf,
    /// How fast, 0.1 to 10 times the recording
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    rate: f64,
    /// Begin this long after the first message, s
    #[arg(long, value_name = "S", default_value_t = 0.0)]
    start: f64,
    /// At the end begin again at --start, until stopped
    #[arg(long = "loop")]
    again: bool,
    /// Begin paused
    #[arg(long)]
    pause: bool,
    /// Only these topics
    #[arg(long = "topic", value_name = "NAME")]
    topics: Vec<String>,
    /// Publish the recording's time on /clock at 100 Hz (a /clock in the bag is then left out)
    #[arg(long)]
    clock: bool,
    /// Offer every topic reliably, whatever it was recorded with, and wait for subscribers that fall behind
    #[arg(long)]
    reliable: bool,
    /// Offer topics as this file says, whatever they were recorded with: the YAML file of `ros2 bag play`
    #[arg(long, value_name = "FILE")]
    qos_profile_overrides_path: Option<PathBuf>,
    /// Time for subscribers to find the topics before the first message, s
    #[arg(long, value_name = "S", default_value_t = 1.0)]
    delay: f64,
    /// --ros-args and what ROS 2 allows after it (remapping, namespace, log level)
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "--ros-args ...")]
    ros: Vec<String>,
}

/// The clock's depth.
const DEPTH: usize = 10;
/// Pace at which large messages arrive, retransmissions included.
const BYTES_PER_MS: u64 = 20_000;
/// How often controls are looked at while waiting, and the clock's period.
const TICK: Duration = Duration::from_millis(10);

/// Runs the subcommand.
pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    check_rate(arguments.rate)?;
    let bag = super::open(&arguments.bag)?;
    let Some((start_ns, end_ns)) = bag.span_ns() else { bail!("{}: there is no message in it", bag.path().display()) };
    let duration_s = (end_ns - start_ns) as f64 * 1e-9;
    check_seek(arguments.start, duration_s)?;
    if !(0.0..=3600.0).contains(&arguments.delay) {
        bail!("--delay is {}; expected 0 to 3600 s", arguments.delay);
    }
    super::check_topics(&bag, &arguments.topics)?;
    let node = node(arguments)?;
    let overrides = arguments.qos_profile_overrides_path.as_deref().map(overrides).transpose()?.unwrap_or_default();
    let wanted = |name: &str| {
        let replaced = arguments.clock && name == "/clock";
        !replaced && (arguments.topics.is_empty() || arguments.topics.iter().any(|topic| topic == name))
    };
    let topics = Offered::all(&node, &bag, &overrides, arguments.reliable, wanted)?;
    let clock = arguments.clock.then(|| node.publisher::<Clock>("/clock", Qos::reliable(DEPTH))).transpose()?;
    let controls = controls(&node)?;
    let count = topics.iter().flatten().count();
    say!(
        "{}: {duration_s:.1} s, {} messages on {count} topics, at {} times real time",
        bag.path().display(),
        bag.message_count(),
        arguments.rate
    )?;
    rest(&node, Duration::from_secs_f64(arguments.delay));
    let mut player = Player {
        bag: &bag,
        node: &node,
        topics,
        clock,
        controls,
        start_ns,
        wait_for_slow: arguments.reliable,
        rate: arguments.rate,
        paused: arguments.pause,
        pace: Pacing { wall: Instant::now(), bag_ns: start_ns },
        next_tick: Instant::now(),
        sent: 0,
        recent: (Instant::now(), 0, 0),
        lost: 0,
    };
    let begin_ns = start_ns + (arguments.start * 1e9) as u64;
    let mut from_ns = begin_ns;
    loop {
        match player.play(from_ns)? {
            Ended::AtEnd if arguments.again => from_ns = begin_ns,
            Ended::Seek(to_ns) => from_ns = to_ns,
            Ended::AtEnd | Ended::Stopped => break,
        }
    }
    let (sent, lost, time_to_arrive) = (player.sent, player.lost, player.time_to_arrive());
    let written = say!("{sent} messages sent{}", if lost > 0 { format!(", {lost} lost") } else { String::new() });
    // The last messages may still be on their way, or asked for again: their publishers stay.
    rest(&node, time_to_arrive);
    drop(player);
    node.shutdown();
    written?;
    Ok(if lost == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn node(arguments: &Arguments) -> Result<Node> {
    if let Some(first) = arguments.ros.first()
        && first != "--ros-args"
    {
        bail!("'{first}' is not known; expected options as in --help, or --ros-args");
    }
    let line = std::iter::once("tandem".to_owned()).chain(arguments.ros.iter().cloned());
    let (ros_arguments, _) = ros::Arguments::from_line(line)?;
    Ok(Node::start("bag_player", &ros_arguments)?)
}

/// Waits, unless it is asked to stop.
fn rest(node: &Node, time: Duration) {
    let end = Instant::now() + time;
    while !node.stop().is_requested() && Instant::now() < end {
        std::thread::sleep(TICK.min(end.saturating_duration_since(Instant::now())));
    }
}

fn check_rate(rate: f64) -> Result<()> {
    if !(0.1..=10.0).contains(&rate) {
        bail!("the rate is {rate}; expected 0.1 to 10");
    }
    Ok(())
}

fn check_seek(at_s: f64, duration_s: f64) -> Result<()> {
    if !(0.0..=duration_s).contains(&at_s) {
        bail!("{at_s} s is not in the recording; expected 0 to {duration_s:.3} s");
    }
    Ok(())
}

enum Ended {
    AtEnd,
    Stopped,
    Seek(u64),
}

/// At which time of the wall clock which time of the bag was due.
#[derive(Clone, Copy)]
struct Pacing {
    wall: Instant,
    bag_ns: u64,
}

struct Player<'a> {
    bag: &'a Bag,
    node: &'a Node,
    topics: Vec<Option<Offered>>,
    clock: Option<ros::Publisher<Clock>>,
    controls: Receiver<Control>,
    start_ns: u64,
    wait_for_slow: bool,
    rate: f64,
    paused: bool,
    pace: Pacing,
    next_tick: Instant,
    sent: u64,
    /// When the present second began, and how long, ms, what was sent in the one before, and in it, may take to arrive.
    recent: (Instant, u64, u64),
    lost: u64,
}

impl Player<'_> {
    fn play(&mut self, from_ns: u64) -> Result<Ended> {
        let mut messages = self.bag.messages()?;
        let first = self.skip_to(&mut messages, from_ns)?;
        self.pace = Pacing { wall: Instant::now(), bag_ns: from_ns };
        for message in first.map(Ok).into_iter().chain(messages) {
            let message = message?;
            if let Some(ended) = self.wait_until(message.stamp_ns)? {
                return Ok(ended);
            }
            self.send(&message)?;
        }
        Ok(Ended::AtEnd)
    }

    /// Passes over what comes before, but sends what each latched topic keeps for late subscribers. Gives the first
    /// message due.
    fn skip_to(&mut self, messages: &mut Messages, from_ns: u64) -> Result<Option<Message>> {
        let mut latched: VecDeque<Message> = VecDeque::new();
        let mut kept = vec![0; self.topics.len()];
        let mut first = None;
        for message in messages {
            let message = message?;
            if message.stamp_ns >= from_ns {
                first = Some(message);
                break;
            }
            let topic = message.topic;
            let most = self.topics[topic].as_ref().map_or(0, |topic| topic.kept);
            if most == 0 {
                continue;
            }
            kept[topic] += 1;
            if kept[topic] > most
                && let Some(oldest) = latched.iter().position(|message| message.topic == topic)
            {
                latched.remove(oldest);
                kept[topic] -= 1;
            }
            latched.push_back(message);
        }
        for message in latched {
            self.send(&message)?;
        }
        Ok(first)
    }

    /// The bag's time now.
    fn now_ns(&self) -> u64 {
        if self.paused {
            return self.pace.bag_ns;
        }
        self.pace.bag_ns + (self.pace.wall.elapsed().as_secs_f64() * self.rate * 1e9) as u64
    }

    fn set_pace(&mut self, change: impl FnOnce(&mut Self)) {
        let bag_ns = self.now_ns();
        change(self);
        self.pace = Pacing { wall: Instant::now(), bag_ns };
    }

    /// Waits until a message is due, obeying controls and publishing the clock meanwhile.
    fn wait_until(&mut self, stamp_ns: u64) -> Result<Option<Ended>> {
        loop {
            if self.node.stop().is_requested() {
                return Ok(Some(Ended::Stopped));
            }
            match self.controls.try_recv() {
                Ok(Control::Pause(paused)) => self.set_pace(|player| player.paused = paused),
                Ok(Control::Rate(rate)) => match check_rate(rate) {
                    Ok(()) => self.set_pace(|player| player.rate = rate),
                    Err(error) => note!("{error}"),
                },
                Ok(Control::Seek(at_s)) => {
                    let duration_s = self.bag.span_ns().map_or(0.0, |(start, end)| (end - start) as f64 * 1e-9);
                    match check_seek(at_s, duration_s) {
                        Ok(()) => return Ok(Some(Ended::Seek(self.start_ns + (at_s * 1e9) as u64))),
                        Err(error) => note!("{error}"),
                    }
                }
                Ok(Control::Quit) => return Ok(Some(Ended::Stopped)),
                // Standard input at its end is no reason to stop.
                Err(TryRecvError::Empty | TryRecvError::Disconnected) => {}
            }
            let now_ns = self.now_ns();
            if Instant::now() >= self.next_tick {
                self.next_tick = Instant::now() + TICK;
                if let Some(clock) = &self.clock {
                    // Never later than a message that is still to come, though this program runs late.
                    let clock_ns = now_ns.min(stamp_ns);
                    let time = Time {
                        sec: (clock_ns / 1_000_000_000).try_into().unwrap_or(i32::MAX),
                        nanosec: (clock_ns % 1_000_000_000) as u32,
                    };
                    clock.publish(Clock { clock: time })?;
                }
            }
            if !self.paused && now_ns >= stamp_ns {
                return Ok(None);
            }
            let left =
                if self.paused { TICK } else { Duration::from_secs_f64((stamp_ns - now_ns) as f64 * 1e-9 / self.rate) };
            std::thread::sleep(left.min(TICK));
        }
    }

    fn count_recent(&mut self, bytes: usize) {
        let (began, before, now) = &mut self.recent;
        if began.elapsed() >= Duration::from_secs(1) {
            (*began, *before, *now) = (Instant::now(), *now, 0);
        }
        *now += 1 + bytes as u64 / BYTES_PER_MS;
    }

    /// What a slow reliable subscriber needs for what was sent last: half a second, and a millisecond a message and 20
    /// kB.
    fn time_to_arrive(&self) -> Duration {
        let (_, before, now) = self.recent;
        Duration::from_millis(500 + (before + now).min(10_000))
    }

    fn send(&mut self, message: &Message) -> Result<()> {
        let Some(topic) = &mut self.topics[message.topic] else { return Ok(()) };
        let patience = Instant::now() + Duration::from_secs(10);
        loop {
            match topic.publisher.publish(&message.data) {
                Ok(()) => {
                    self.sent += 1;
                    self.count_recent(message.data.len());
                    return Ok(());
                }
                Err(PublishError::Full { .. }) if self.wait_for_slow && Instant::now() < patience => {
                    std::thread::sleep(Duration::from_millis(1));
                }
                Err(PublishError::Full { .. }) => {
                    self.lost += 1;
                    return Ok(());
                }
                // Such as a message that is no little-endian CDR: the others are played.
                Err(error) => {
                    self.lost += 1;
                    if !std::mem::replace(&mut topic.reported, true) {
                        note!("{error}");
                    }
                    return Ok(());
                }
            }
        }
    }
}
