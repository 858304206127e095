//! Log lines go to standard error and, like those of every ROS 2 node, to a file and to `/rosout`.

use std::fmt::Write as _;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Instant;

use tandem_msgs::builtin_interfaces::Time;
use tandem_msgs::rcl_interfaces::Log;
use tracing::{Event, Level, Metadata, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::fmt::format::debug_fn;
use tracing_subscriber::layer::{Context, SubscriberExt};
use tracing_subscriber::util::SubscriberInitExt;

use crate::log_text::{Text, write_field};
use crate::{Arguments, log_file};

/// Lines that wait for the publisher. When it is full further lines reach standard error only: logging never waits.
const WAITING_LINES: usize = 1024;

/// Lines of the middleware a second: most of them are about what others send, and whoever floods it must not fill the
/// log.
const MIDDLEWARE_LINES: u64 = 10;

static ROSOUT: OnceLock<SyncSender<Log>> = OnceLock::new();

/// Installs the process's log subscriber, once; a program that has its own keeps it. The first node of a process gets
/// the lines for `/rosout`. `logger` is the node's name in the file.
pub(crate) fn start(arguments: &Arguments, node: &str, logger: &str) -> Option<Receiver<Log>> {
    // The middleware's own warnings are about other participants' endpoints more often than about ours, and two of its
    // modules call errors what is none: other types on a topic, which a subscription says itself, and leaving a group
    // that the loopback never joined.
    let mut directives = format!(
        "{},rustdds=error,ros2_client=error,rustdds::discovery::discovery_db=off,rustdds::network::udp_listener=off",
        arguments.log_level.as_deref().unwrap_or("info")
    );
    for (logger, level) in &arguments.logger_levels {
        let target = if logger == node { "tandem" } else { logger };
        let _ = write!(directives, ",{target}={level}"); // writing to a String cannot fail
    }
    // Not the filter that the environment configures: it brings two engines of regular expressions into every node.
    let filter: Targets = directives.parse().unwrap_or_else(|_| Targets::new().with_default(Level::INFO));
    let (sender, receiver) = sync_channel(WAITING_LINES);
    let first = arguments.rosout && ROSOUT.set(sender).is_ok();
    let lines = screen_layer(std::io::stderr, std::io::IsTerminal::is_terminal(&std::io::stderr()));
    let file = (first && arguments.log_file.wanted).then(|| log_file::start(&arguments.log_file, logger));
    let (file, failure) = match file {
        Some(Ok(file)) => (Some(file), None),
        Some(Err(reason)) => (None, Some(reason)),
        None => (None, None),
    };
    let place = file.as_ref().map(|file| file.path().display().to_string());
    // Fails where the program has installed its own subscriber, which is its right.
    let layers = tracing_subscriber::registry().with(FewLines::new()).with(filter).with(lines).with(RosoutLayer);
    let _ = layers.with(file).try_init();
    if let Some(place) = place {
        tracing::debug!("the log's copy is {place}");
    }
    if let Some(reason) = failure {
        tracing::warn!("the log has no copy in a file: {reason}; --disable-external-lib-logs asks for none");
    }
    first.then_some(receiver)
}

fn screen_layer<S, W>(writer: W, colours: bool) -> impl Layer<S>
where
    S: Subscriber + for<'a> tracing_subscriber::registry::LookupSpan<'a>,
    W: for<'a> tracing_subscriber::fmt::MakeWriter<'a> + Send + Sync + 'static,
{
    tracing_subscriber::fmt::layer()
        .fmt_fields(debug_fn(|writer, field, value| write_field(writer, field.name(), value)))
        .with_writer(writer)
        .with_ansi(colours)
        .with_target(false)
        .log_internal_errors(false)
}

/// Lets so many of the middleware's lines pass in each second, and all others. The innermost layer: it is asked for
/// lines that the filter lets pass.
struct FewLines {
    began: Instant,
    /// The second in the upper half, the lines in it in the lower.
    lines: AtomicU64,
}

impl FewLines {
    fn new() -> Self {
        Self { began: Instant::now(), lines: AtomicU64::new(0) }
    }

    fn passes(&self, second: u64) -> bool {
        let second = second << 32;
        let count = |lines: u64| if lines >> 32 == second >> 32 { lines + 1 } else { second + 1 };
        let before = self.lines.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |lines| Some(count(lines)));
        count(before.unwrap_or(0)) & 0xffff_ffff <= MIDDLEWARE_LINES
    }
}

impl<S: Subscriber> Layer<S> for FewLines {
    fn enabled(&self, metadata: &Metadata<'_>, _context: Context<'_, S>) -> bool {
        let of_the_middleware =
            metadata.target().starts_with("rustdds") || metadata.target().starts_with("ros2_client");
        !of_the_middleware || self.passes(self.began.elapsed().as_secs())
    }
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

/// The stamp of a line that has none.
pub(crate) fn named(mut line: Log, name: &str) -> Log {
    line.name = name.to_string();
    if line.stamp == Time::default() {
        line.stamp = crate::time::wall_time();
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log_text::LINE_CHARS;
    use std::io::Write;
    use std::sync::{Arc, Mutex};

    #[derive(Clone, Default)]
    struct Screen(Arc<Mutex<Vec<u8>>>);

    impl Write for Screen {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            self.0.lock().unwrap().extend_from_slice(bytes);
            Ok(bytes.len())
        }
        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_name_with_a_newline_fakes_no_line_of_the_log() {
        let screen = Screen::default();
        let writer = screen.clone();
        let subscriber = tracing_subscriber::registry().with(screen_layer(move || writer.clone(), false));
        tracing::subscriber::with_default(subscriber, || {
            let name = "trot\n2026-01-01T00:00:00Z  INFO armed\u{1b}[2J\u{202e}";
            tracing::info!("gait {name} refused");
            tracing::warn!(name, "a field");
            tracing::warn!("{}", "x".repeat(1 << 20));
        });
        let shown = String::from_utf8(screen.0.lock().unwrap().clone()).unwrap();
        let lines: Vec<&str> = shown.lines().collect();
        assert_eq!(lines.len(), 3, "{shown}");
        assert!(lines[0].contains(r"trot\n2026-01-01T00:00:00Z  INFO armed\u{1b}[2J\u{202e} refused"), "{shown}");
        assert!(!shown.contains(['\u{1b}', '\u{202e}']) && lines[1].contains("a field name="), "{shown}");
        assert!(lines[2].chars().count() < LINE_CHARS + 100 && lines[2].ends_with('…'));

        let mut text = Text::default();
        let _ = write_field(&mut text.message, "message", &format_args!("a\nb\u{7}"));
        assert_eq!(text.message, r"a\nb\u{7}", "the line on /rosout");
    }

    #[test]
    fn a_flood_of_the_middlewares_lines_is_ten_a_second() {
        let lines = FewLines::new();
        let passed = |second: u64| (0..1000).filter(|_| lines.passes(second)).count() as u64;
        assert_eq!([passed(0), passed(1), passed(7)], [MIDDLEWARE_LINES; 3]);
    }
}
