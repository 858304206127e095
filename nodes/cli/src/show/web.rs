//! The view in a browser: one page, the robot's state as a stream of events, and the stop button. HTTP/1.1, on this
//! machine alone.

mod button;
mod frame;
mod request;

use super::{Received, Shapes};
use anyhow::{Context, Result};
use button::Button;
use frame::Frames;
use request::{Access, Refusal, Route};
use ros::Node;
use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;

const PAGE: &str = include_str!("web/page.html");
/// Connections at once. A browser opens six to one place.
const CONNECTIONS: usize = 32;
/// Of them streams of events: one a page. The others are left for the stop button.
const STREAMS: usize = 8;
/// A stream that takes nothing for so long has lost its reader.
const WRITE_PATIENCE: Duration = Duration::from_secs(2);
const TEXT: &str = "text/plain; charset=utf-8";
/// Bytes of a secret.
const SECRET_BYTES: usize = 16;

/// The newest frame, for all streams.
#[derive(Default)]
struct Hub {
    newest: Mutex<(u64, Arc<str>)>,
    changed: Condvar,
    connections: AtomicUsize,
    streams: AtomicUsize,
}

impl Hub {
    fn show(&self, frame: String) {
        let mut newest = self.newest.lock().unwrap_or_else(PoisonError::into_inner);
        *newest = (newest.0 + 1, frame.into());
        self.changed.notify_all();
    }

    /// The number of the newest frame, which may be old: none are made while nobody looks.
    fn number(&self) -> u64 {
        self.newest.lock().unwrap_or_else(PoisonError::into_inner).0
    }

    /// Waits for a frame after this one. A reader that is slow misses frames, and holds up nobody.
    fn after(&self, seen: u64) -> (u64, Arc<str>) {
        let newest = self.newest.lock().unwrap_or_else(PoisonError::into_inner);
        let newest = self.changed.wait_while(newest, |newest| newest.0 == seen).unwrap_or_else(PoisonError::into_inner);
        (newest.0, Arc::clone(&newest.1))
    }
}

/// One of a bounded number, until it is dropped.
struct Place<'a>(&'a AtomicUsize);

impl<'a> Place<'a> {
    fn take(taken: &'a AtomicUsize, most: usize) -> Option<Self> {
        let one_more = |taken| (taken < most).then_some(taken + 1);
        taken.fetch_update(Ordering::AcqRel, Ordering::Acquire, one_more).ok().map(|_| Place(taken))
    }
}

impl Drop for Place<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::AcqRel);
    }
}

/// A number that nobody guesses, as text.
fn secret() -> Result<String> {
    let mut bytes = [0; SECRET_BYTES];
    std::fs::File::open("/dev/urandom").and_then(|mut file| file.read_exact(&mut bytes)).context("/dev/urandom")?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Serves the page until the node is asked to stop.
pub fn serve(node: &Node, received: &Mutex<Received>, shapes: &mut Shapes, port: u16, period: Duration) -> Result<()> {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).with_context(|| {
        format!("port {port} of this machine; choose another one: --web=PORT, or 0 for one that is free")
    })?;
    let port = listener.local_addr().context("the port")?.port();
    let button = Arc::new(Button::new(node)?);
    let repeated = Arc::clone(&button);
    node.every(button::PERIOD, move || repeated.repeat());
    let hub = Arc::new(Hub::default());
    let server = Arc::new(Server {
        access: Access { port, token: secret()? },
        button: Arc::clone(&button),
        hub: Arc::clone(&hub),
        robot: shapes.robot.name.clone(),
    });
    std::thread::Builder::new().name("web".into()).spawn(move || server.accept(&listener)).context("a thread")?;
    say!("http://127.0.0.1:{port} shows the robot, on this machine alone; Ctrl-C ends it")?;
    let mut frames = Frames::new();
    while !node.stop().is_requested() {
        std::thread::sleep(period);
        if hub.streams.load(Ordering::Acquire) > 0 {
            let stop = button.state(node.subscription_count("emergency_stop"));
            hub.show(frames.next(shapes, &received.lock().unwrap_or_else(PoisonError::into_inner), &stop));
        }
    }
    Ok(())
}

struct Server {
    access: Access,
    button: Arc<Button>,
    hub: Arc<Hub>,
    robot: String,
}

impl Server {
    fn accept(self: &Arc<Self>, listener: &TcpListener) {
        for stream in listener.incoming() {
            // A connection that is gone again, or no descriptor free for it: the next one.
            let Ok(stream) = stream else {
                std::thread::sleep(Duration::from_millis(10));
                continue;
            };
            let server = Arc::clone(self);
            let serve = move || {
                // Dropped without an answer: whoever opens so many knows why.
                let Some(_place) = Place::take(&server.hub.connections, CONNECTIONS) else { return };
                // A reader that is gone is nobody to tell.
                let _ = server.answer(stream);
            };
            if let Err(error) = std::thread::Builder::new().name("web-request".into()).spawn(serve) {
                note!("a connection is not served: {error}");
            }
        }
    }

    fn answer(&self, mut stream: TcpStream) -> std::io::Result<()> {
        stream.set_write_timeout(Some(WRITE_PATIENCE))?;
        stream.set_nodelay(true)?;
        let route = request::read(&mut stream).and_then(|request| self.access.route(&request));
        match route {
            Ok(Route::Page) => self.page(stream),
            Ok(Route::Events) => self.events(stream),
            Ok(Route::Press) => acknowledge(stream, self.button.press()),
            Ok(Route::Release) => acknowledge(stream, self.button.release()),
            Err(Refusal { status, reason }) => {
                respond(&mut stream, status, TEXT, "", &format!("{reason}\n"))?;
                request::let_go(&mut stream)
            }
        }
    }

    fn page(&self, mut stream: TcpStream) -> std::io::Result<()> {
        let nonce = secret().map_err(std::io::Error::other)?;
        let body = PAGE.replace("__NONCE__", &nonce).replace("__TOKEN__", &self.access.token).replace(
            "__ROBOT__",
            &self.robot.replace(|c: char| !c.is_ascii_alphanumeric() && !"_-. ".contains(c), "?"),
        );
        // Nothing from elsewhere, and in no other page's frame, where a click could be led astray.
        let policy = format!(
            "default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; connect-src 'self'; img-src data:; \
             base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        );
        let more = format!("Content-Security-Policy: {policy}\r\nX-Frame-Options: DENY\r\n");
        respond(&mut stream, "200 OK", "text/html; charset=utf-8", &more, &body)
    }

    fn events(&self, mut stream: TcpStream) -> std::io::Result<()> {
        let Some(_place) = Place::take(&self.hub.streams, STREAMS) else {
            return plain(stream, "503 Service Unavailable", "as many pages are open as are served at once\n");
        };
        let head = "HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nCache-Control: no-store\r\nConnection: close\r\n\
                    X-Content-Type-Options: nosniff\r\n\r\nretry: 500\n\n";
        stream.write_all(head.as_bytes())?;
        let mut seen = self.hub.number();
        loop {
            let (number, frame) = self.hub.after(seen);
            seen = number;
            stream.write_all(format!("data: {frame}\n\n").as_bytes())?;
        }
    }
}

fn acknowledge(stream: TcpStream, sent: Result<(), String>) -> std::io::Result<()> {
    match sent {
        Ok(()) => plain(stream, "200 OK", "sent\n"),
        Err(reason) => plain(stream, "500 Internal Server Error", &format!("not sent: {reason}\n")),
    }
}

fn plain(mut stream: TcpStream, status: &str, body: &str) -> std::io::Result<()> {
    respond(&mut stream, status, TEXT, "", body)
}

fn respond(stream: &mut TcpStream, status: &str, kind: &str, more: &str, body: &str) -> std::io::Result<()> {
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nCache-Control: no-store\r\nConnection: close\r\n\
         X-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\n{more}\r\n",
        body.len()
    );
    stream.write_all(head.as_bytes())?;
    stream.write_all(body.as_bytes())
}
