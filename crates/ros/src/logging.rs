//! Log lines go to standard error and, like those of every ROS 2 node, to `/rosout`.

use std::fmt::Write as _;
use std::sync::OnceLock;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use tandem_msgs::builtin_interfaces::Time;
use tandem_msgs::rcl_interfaces::Log;
use tracing::field::{Field, Visit};
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::layer::{Context, SubscriberExt};
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{EnvFilter, Layer};

use crate::Arguments;

/// Lines that wait for the publisher. When it is full further lines reach standard error only: logging never waits.
const WAITING_LINES: usize = 1024;

static ROSOUT: OnceLock<SyncSender<Log>> = OnceLock::new();

/// Installs the process's log subscriber, once; a program that has its own keeps it. The first node of a process gets the
/// lines for `/rosout`.
pub(crate) fn start(arguments: &Arguments, node: &str) -> Option<Receiver<Log>> {
    // The middleware's own warnings are about other participants' endpoints more often than about ours, and two of its modules
    // call errors what is none: other types on a topic, which a subscription says itself, and leaving a group that the loopback
    // never joined.
    let mut directives = format!(
        "{},rustdds=error,ros2_client=error,rustdds::discovery::discovery_db=off,rustdds::network::udp_listener=off",
        arguments.log_level.as_deref().unwrap_or("info")
    );
    for (logger, level) in &arguments.logger_levels {
        let target = if logger == node { "tandem" } else { logger };
        let _ = write!(directives, ",{target}={level}"); // writing to a String cannot fail
    }
    let filter = EnvFilter::try_new(&directives).unwrap_or_else(|_| EnvFilter::new("info"));
    let (sender, receiver) = sync_channel(WAITING_LINES);
    let first = arguments.rosout && ROSOUT.set(sender).is_ok();
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::IsTerminal::is_terminal(&std::io::stderr()))
        .with_target(false);
    // Fails where the program has installed its own subscriber, which is its right.
    let _ = tracing_subscriber::registry().with(filter).with(lines).with(RosoutLayer).try_init();
    first.then_some(receiver)
}

struct RosoutLayer;

impl<S: Subscriber> Layer<S> for RosoutLayer {
    fn on_event(&self, event: &Event<'_>, _context: Context<'_, S>) {
        let metadata = event.metadata();
        let target = metadata.target();
        // The middleware's lines about publishing a line would publish a line.
        if target == "log" || target.starts_with("rustdds") || target.starts_with("ros2_client") {
            return;
        }
        let Some(sender) = ROSOUT.get() else { return };
        let mut text = Text::default();
        event.record(&mut text);
        let line = Log {
            stamp: crate::time::wall_time(),
            level: match *metadata.level() {
                Level::ERROR => 40,
                Level::WARN => 30,
                Level::INFO => 20,
                Level::DEBUG | Level::TRACE => 10,
            },
            name: String::new(), // the publisher fills in the node's name
            msg: text.message + &text.fields,
            file: metadata.file().unwrap_or_default().to_string(),
            function: target.to_string(),
            line: metadata.line().unwrap_or_default(),
        };
        // A full queue drops the line here; it has gone to standard error.
        let _ = sender.try_send(line);
    }
}

#[derive(Default)]
struct Text {
    message: String,
    fields: String,
}

impl Visit for Text {
    fn record_debug(&mut self, field: &Field, value: &dyn std::fmt::Debug) {
        // Writing to a String cannot fail.
        let _ = if field.name() == "message" {
            write!(self.message, "{value:?}")
        } else {
            write!(self.fields, " {}={value:?}", field.name())
        };
    }
}

/// The stamp of a line that has none.
pub(crate) fn named(mut line: Log, name: &str) -> Log {
    line.name = name.to_string();
    if line.stamp == Time::default() {
        line.stamp = crate::time::wall_time();
    }
    line
}
