//! Requests of browsers: read within bounds, and let in or refused. A page of somebody else's, open in the same
//! browser, can send requests here too; it does not see the token, and it cannot say that it is another page.

use std::io::Read;
use std::net::{Shutdown, TcpStream};
use std::time::{Duration, Instant};

/// Bytes of a request, at most: a browser's are below one kilobyte.
const HEAD_BYTES: usize = 8192;
/// How long a request may take to arrive.
const PATIENCE: Duration = Duration::from_secs(2);
/// How long a refused one may go on sending.
const LINGER: Duration = Duration::from_millis(300);

/// Why a request is refused: the status of the answer and a sentence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refusal {
    pub status: &'static str,
    pub reason: &'static str,
}

const fn bad(reason: &'static str) -> Refusal {
    Refusal { status: "400 Bad Request", reason }
}

const fn forbidden(reason: &'static str) -> Refusal {
    Refusal { status: "403 Forbidden", reason }
}

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Route {
    Page,
    Events,
    Press,
    Release,
}

/// A request's first line and headers; it has no body.
#[derive(Debug)]
pub struct Request {
    method: String,
    path: String,
    /// Names in lower case.
    headers: Vec<(String, String)>,
}

impl Request {
    fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|header| header.0 == name).map(|header| header.1.as_str())
    }

    fn parse(head: &[u8]) -> Result<Self, Refusal> {
        let head = std::str::from_utf8(head).map_err(|_| bad("no text"))?;
        let mut lines = head.split("\r\n");
        let first: Vec<&str> = lines.next().unwrap_or_default().split(' ').collect();
        let [method, path, "HTTP/1.1" | "HTTP/1.0"] = first[..] else { return Err(bad("no request of HTTP/1")) };
        let mut headers: Vec<(String, String)> = Vec::new();
        for line in lines.filter(|line| !line.is_empty()) {
            let (name, value) = line.split_once(':').ok_or(bad("a header without a colon"))?;
            let name = name.to_ascii_lowercase();
            // Two of one name: which of them counts would be a guess.
            if headers.iter().any(|header| header.0 == name) {
                return Err(bad("a header twice"));
            }
            headers.push((name, value.trim().to_owned()));
        }
        let request = Request { method: method.into(), path: path.into(), headers };
        let has_body = request.header("content-length").is_some_and(|length| length != "0");
        if has_body || request.header("transfer-encoding").is_some() {
            return Err(Refusal { status: "413 Content Too Large", reason: "no request here has a body" });
        }
        Ok(request)
    }
}

/// Reads a request.
pub fn read(stream: &mut TcpStream) -> Result<Request, Refusal> {
    let begun = Instant::now();
    let mut head = Vec::new();
    let mut part = [0; 1024];
    loop {
        if let Some(end) = head.windows(4).position(|bytes| bytes == b"\r\n\r\n") {
            return Request::parse(&head[..end]);
        }
        if head.len() >= HEAD_BYTES {
            return Err(Refusal { status: "431 Request Header Fields Too Large", reason: "8 KiB are the most" });
        }
        let left = PATIENCE.saturating_sub(begun.elapsed()).max(Duration::from_millis(1));
        let late = Refusal { status: "408 Request Timeout", reason: "the request did not arrive within 2 s" };
        if begun.elapsed() >= PATIENCE || stream.set_read_timeout(Some(left)).is_err() {
            return Err(late);
        }
        match stream.read(&mut part) {
            Ok(0) => return Err(bad("the request ends within its headers")),
            Ok(length) => head.extend_from_slice(&part[..length]),
            Err(_) => return Err(late),
        }
    }
}

/// Takes some of what is still coming: a connection that is closed before that is broken off, and its answer with it.
pub fn let_go(stream: &mut TcpStream) -> std::io::Result<()> {
    stream.shutdown(Shutdown::Write)?;
    stream.set_read_timeout(Some(LINGER))?;
    let begun = Instant::now();
    let mut part = [0; 1024];
    while begun.elapsed() < LINGER && stream.read(&mut part)? > 0 {}
    Ok(())
}

/// Who is let in.
pub struct Access {
    /// The port that is listened on.
    pub port: u16,
    /// What the page was given and every press has to show.
    pub token: String,
}

impl Access {
    /// Where a request leads to.
    pub fn route(&self, request: &Request) -> Result<Route, Refusal> {
        let own = ["127.0.0.1", "localhost"].map(|name| format!("{name}:{}", self.port));
        // A name of somebody else's that leads to this machine (DNS rebinding) is not ours.
        let host = request.header("host").unwrap_or_default();
        if !own.iter().any(|own| own == host) {
            return Err(forbidden("not this page's address; use the one that tandem show printed"));
        }
        let origin = request.header("origin");
        let foreign = origin.is_some_and(|origin| origin != format!("http://{host}"));
        let site = request.header("sec-fetch-site").unwrap_or("none");
        let route = match (request.method.as_str(), request.path.as_str()) {
            ("GET", "/") => Route::Page,
            ("GET", "/events") => Route::Events,
            ("POST", "/press") => Route::Press,
            ("POST", "/release") => Route::Release,
            (_, "/" | "/events" | "/press" | "/release") => {
                return Err(Refusal { status: "405 Method Not Allowed", reason: "not by this method" });
            }
            _ => return Err(Refusal { status: "404 Not Found", reason: "there is no such page" }),
        };
        // A link on another page may lead to this one.
        if foreign || (route != Route::Page && !matches!(site, "none" | "same-origin")) {
            return Err(forbidden("asked by another page"));
        }
        let presses = matches!(route, Route::Press | Route::Release);
        if presses && (origin.is_none() || !same(request.header("x-tandem-token").unwrap_or_default(), &self.token)) {
            return Err(forbidden("only the page itself may do this; reload it if tandem show was started anew"));
        }
        Ok(route)
    }
}

/// Takes as long wherever they differ.
fn same(given: &str, expected: &str) -> bool {
    given.len() == expected.len() && given.bytes().zip(expected.bytes()).fold(0, |sum, (a, b)| sum | (a ^ b)) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    const OWN: &str = "Host: 127.0.0.1:8642\r\nOrigin: http://127.0.0.1:8642\r\nX-Tandem-Token: abc";

    fn asked(line: &str, headers: &str) -> Result<Route, &'static str> {
        let access = Access { port: 8642, token: "abc".into() };
        let request = Request::parse(format!("{line} HTTP/1.1\r\n{headers}").as_bytes());
        request.and_then(|request| access.route(&request)).map_err(|refusal| &refusal.status[..3])
    }

    #[test]
    fn the_page_itself_presses_and_releases() {
        assert_eq!(asked("GET /", "Host: localhost:8642"), Ok(Route::Page));
        assert_eq!(asked("GET /", "Host: localhost:8642\r\nSec-Fetch-Site: cross-site"), Ok(Route::Page), "a link");
        assert_eq!(asked("GET /events", "host:127.0.0.1:8642\r\nSec-Fetch-Site: same-origin"), Ok(Route::Events));
        assert_eq!(asked("POST /press", OWN), Ok(Route::Press));
        assert_eq!(asked("POST /release", &format!("{OWN}\r\nContent-Length: 0")), Ok(Route::Release));
    }

    #[test]
    fn another_page_neither_presses_nor_reads() {
        for line in ["POST /press", "POST /release", "GET /events", "GET /"] {
            for (own, other) in [
                ("Host: 127.0.0.1:8642", "Host: robot.example:8642"),
                ("Host: 127.0.0.1:8642", "Host: 127.0.0.1:80"),
                ("Host: 127.0.0.1:8642\r\n", ""),
                ("http://127.0.0.1:8642", "http://robot.example"),
                ("http://127.0.0.1:8642", "https://127.0.0.1:8642"),
                ("http://127.0.0.1:8642", "http://127.0.0.1:8643"),
                ("http://127.0.0.1:8642", "http://localhost:8642"),
                ("http://127.0.0.1:8642", "null"),
            ] {
                assert_eq!(asked(line, &OWN.replace(own, other)), Err("403"), "{line}: {other}");
            }
        }
        for line in ["POST /press", "POST /release"] {
            for (own, other) in [("abc", "abd"), ("abc", ""), ("X-Tandem-Token: abc", "X-Other: abc"), ("abc", "abcd")]
            {
                assert_eq!(asked(line, &OWN.replace(own, other)), Err("403"), "{line}: {other}");
            }
            assert_eq!(asked(line, "Host: 127.0.0.1:8642\r\nX-Tandem-Token: abc"), Err("403"), "no origin");
            assert_eq!(asked(line, &format!("{OWN}\r\nSec-Fetch-Site: cross-site")), Err("403"));
        }
        assert_eq!(asked("GET /events", "Host: 127.0.0.1:8642\r\nSec-Fetch-Site: same-site"), Err("403"));
    }

    #[test]
    fn what_is_no_request_of_the_page_is_refused_by_what_it_is() {
        assert_eq!(asked("GET /press", OWN), Err("405"), "an image or a link presses nothing");
        assert_eq!(asked("OPTIONS /press", OWN), Err("405"), "no other page is allowed to ask");
        assert_eq!(asked("GET /../etc/passwd", OWN), Err("404"));
        assert_eq!(asked("POST /press", &format!("{OWN}\r\nContent-Length: 5")), Err("413"));
        assert_eq!(asked("POST /press", &format!("{OWN}\r\nTransfer-Encoding: chunked")), Err("413"));
        assert_eq!(asked("POST /press", &format!("{OWN}\r\nHost: 127.0.0.1:8642")), Err("400"), "a header twice");
        assert_eq!(asked("GET", OWN), Err("400"));
        assert_eq!(asked("GET /", "no header"), Err("400"));
    }
}
