//! `tandem bag play`: a recording is published with its own timing.

use ::bag::{Bag, Durability, Message, Messages};
use anyhow::{Context, Result, bail};
use ros::{Node, PublishError, Qos, RawPublisher};
use std::io::BufRead;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant};
use tandem_msgs::builtin_interfaces::Time;
use tandem_msgs::rosgraph_msgs::Clock;
use tandem_msgs::std_srvs::{SetBool, SetBoolResponse};

/// Publish a recording with its own timing
///
/// Topics are offered with the quality of service that they were recorded with. Messages on latched topics (gait,
/// robot_description) from before the start are sent first. While it plays, lines on standard input control it: `pause`,
/// `resume`, `seek SECONDS`, `rate FACTOR`, `quit`; the service `bag_player/pause` (std_srvs/SetBool) pauses and resumes.
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
    /// Begin again at the end, until stopped
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
    /// Time for subscribers to find the topics before the first message, s
    #[arg(long, value_name = "S", default_value_t = 1.0)]
    delay: f64,
    /// --ros-args and what ROS 2 allows after it (remapping, namespace, log level)
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "--ros-args ...")]
    ros: Vec<String>,
}

/// Messages kept for reliable subscriptions at least.
const DEPTH: usize = 10;
/// Pace at which large messages arrive, retransmissions included.
const BYTES_PER_MS: u64 = 20_000;
/// How often controls are looked at while waiting, and the clock's period.
const TICK: Duration = Duration::from_millis(10);

#[derive(Clone, Copy)]
enum Control {
    Pause(bool),
    /// s after the first message.
    Seek(f64),
    Rate(f64),
    Quit,
}

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
    for wanted in &arguments.topics {
        if bag.topic(wanted).is_none() {
            let known: Vec<&str> = bag.topics().iter().map(|topic| topic.name.as_str()).collect();
            bail!("there is no topic '{wanted}' in {}; it has {}", bag.path().display(), known.join(", "));
        }
    }
    if let Some(first) = arguments.ros.first()
        && first != "--ros-args"
    {
        bail!("'{first}' is not known; expected options as in --help, or --ros-args");
    }
    let line = std::iter::once("tandem".to_owned()).chain(arguments.ros.iter().cloned());
    let (ros_arguments, _) = ros::Arguments::from_line(line)?;
    let node = Node::start("bag_player", &ros_arguments)?;
    let mut publishers = Vec::new();
    for topic in bag.topics() {
        let wanted = arguments.topics.is_empty() || arguments.topics.contains(&topic.name);
        let replaced = arguments.clock && topic.name == "/clock";
        if !wanted || replaced || topic.encoding != "cdr" || topic.type_name.is_empty() {
            publishers.push(None);
            continue;
        }
        publishers.push(Some(node.raw_publisher(&topic.name, &topic.type_name, qos(topic, arguments.reliable))?));
    }
    let clock = arguments.clock.then(|| node.publisher::<Clock>("/clock", Qos::reliable(DEPTH))).transpose()?;
    let controls = controls(&node)?;
    println!(
        "{}: {duration_s:.1} s, {} messages on {} topics, at {} times real time",
        bag.path().display(),
        bag.message_count(),
        publishers.iter().flatten().count(),
        arguments.rate
    );
    std::thread::sleep(Duration::from_secs_f64(arguments.delay));
    let mut player = Player {
        bag: &bag,
        node: &node,
        publishers,
        clock,
        controls,
        start_ns,
        wait_for_slow: arguments.reliable,
        rate: arguments.rate,
        paused: arguments.pause,
        pace: Pace { wall: Instant::now(), bag_ns: start_ns },
        next_tick: Instant::now(),
        sent: 0,
        recent: (Instant::now(), 0, 0),
        lost: 0,
    };
    let mut from_ns = start_ns + (arguments.start * 1e9) as u64;
    loop {
        match player.play(from_ns)? {
            Ended::AtEnd if arguments.again => from_ns = start_ns,
            Ended::Seek(to_ns) => from_ns = to_ns,
            Ended::AtEnd | Ended::Stopped => break,
        }
    }
    println!(
        "{} messages sent{}",
        player.sent,
        if player.lost > 0 { format!(", {} lost", player.lost) } else { String::new() }
    );
    let lost = player.lost;
    // The last messages may still be on their way, or asked for again.
    std::thread::sleep(player.time_to_arrive());
    drop(player);
    node.shutdown();
    Ok(if lost == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
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

fn qos(topic: &::bag::BagTopic, reliable: bool) -> Qos {
    let recorded = topic.qos.unwrap_or(::bag::Qos::reliable(10));
    let depth = recorded.depth as usize;
    match recorded.durability {
        Durability::TransientLocal => Qos::transient_local(depth),
        Durability::Volatile if reliable => Qos::keep_all(),
        // Serves best-effort subscriptions as well.
        Durability::Volatile => Qos::reliable(depth.max(DEPTH)),
    }
}

/// Standard input and the pause service, as one stream of controls.
fn controls(node: &Node) -> Result<Receiver<Control>> {
    let (sender, receiver) = channel();
    let by_service = sender.clone();
    node.serve::<SetBool>("~/pause", move |request| {
        let done = by_service.send(Control::Pause(request.data)).is_ok();
        SetBoolResponse { success: done, message: if request.data { "paused".into() } else { "playing".into() } }
    })?;
    std::thread::Builder::new()
        .name("controls".into())
        .spawn(move || {
            for line in std::io::stdin().lock().lines() {
                let Ok(line) = line else { return };
                let words: Vec<&str> = line.split_whitespace().collect();
                let number = |text: &str| text.parse::<f64>().ok();
                let control = match words.as_slice() {
                    [] => continue,
                    ["pause"] => Some(Control::Pause(true)),
                    ["resume"] => Some(Control::Pause(false)),
                    ["seek", text] => number(text).map(Control::Seek),
                    ["rate", text] => number(text).map(Control::Rate),
                    ["quit"] => Some(Control::Quit),
                    _ => None,
                };
                match control {
                    Some(control) if sender.send(control).is_err() => return,
                    Some(_) => {}
                    None => eprintln!("'{line}' is not known; expected pause, resume, seek SECONDS, rate FACTOR, quit"),
                }
            }
        })
        .context("cannot start the thread that reads standard input")?;
    Ok(receiver)
}

enum Ended {
    AtEnd,
    Stopped,
    Seek(u64),
}

/// At which time of the wall clock which time of the bag was due.
#[derive(Clone, Copy)]
struct Pace {
    wall: Instant,
    bag_ns: u64,
}

struct Player<'a> {
    bag: &'a Bag,
    node: &'a Node,
    publishers: Vec<Option<RawPublisher>>,
    clock: Option<ros::Publisher<Clock>>,
    controls: Receiver<Control>,
    start_ns: u64,
    wait_for_slow: bool,
    rate: f64,
    paused: bool,
    pace: Pace,
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
        self.pace = Pace { wall: Instant::now(), bag_ns: from_ns };
        for message in first.map(Ok).into_iter().chain(messages) {
            let message = message?;
            if let Some(ended) = self.wait_until(message.stamp_ns)? {
                return Ok(ended);
            }
            self.send(&message)?;
        }
        Ok(Ended::AtEnd)
    }

    /// Passes over what comes before, but sends the last message of each latched topic. Gives the first message due.
    fn skip_to(&mut self, messages: &mut Messages, from_ns: u64) -> Result<Option<Message>> {
        let mut latched: Vec<Option<Message>> = self.publishers.iter().map(|_| None).collect();
        let mut first = None;
        for message in messages {
            let message = message?;
            if message.stamp_ns >= from_ns {
                first = Some(message);
                break;
            }
            let qos = self.bag.topics()[message.topic].qos;
            if qos.is_some_and(|qos| qos.durability == Durability::TransientLocal) {
                let topic = message.topic;
                latched[topic] = Some(message);
            }
        }
        for message in latched.into_iter().flatten() {
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
        self.pace = Pace { wall: Instant::now(), bag_ns };
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
                    Err(error) => eprintln!("{error}"),
                },
                Ok(Control::Seek(at_s)) => {
                    let duration_s = self.bag.span_ns().map_or(0.0, |(start, end)| (end - start) as f64 * 1e-9);
                    match check_seek(at_s, duration_s) {
                        Ok(()) => return Ok(Some(Ended::Seek(self.start_ns + (at_s * 1e9) as u64))),
                        Err(error) => eprintln!("{error}"),
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
                    let time = Time {
                        sec: (now_ns / 1_000_000_000).try_into().unwrap_or(i32::MAX),
                        nanosec: (now_ns % 1_000_000_000) as u32,
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

    /// What a slow reliable subscriber needs for what was sent last: half a second, and a millisecond a message and 20 kB.
    fn time_to_arrive(&self) -> Duration {
        let (_, before, now) = self.recent;
        Duration::from_millis(500 + (before + now).min(10_000))
    }

    fn send(&mut self, message: &Message) -> Result<()> {
        let Some(publisher) = &self.publishers[message.topic] else { return Ok(()) };
        let patience = Instant::now() + Duration::from_secs(10);
        loop {
            match publisher.publish(&message.data) {
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
                Err(error) => return Err(error.into()),
            }
        }
    }
}
