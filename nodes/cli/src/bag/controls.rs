//! How a person or a program controls what is played: lines on standard input, and a service.

use anyhow::{Context, Result};
use ros::Node;
use std::io::BufRead;
use std::sync::mpsc::{Receiver, channel};
use tandem_msgs::std_srvs::{SetBool, SetBoolResponse};

/// What is asked of the player.
#[derive(Clone, Copy)]
pub enum Control {
    /// Pauses, or goes on.
    Pause(bool),
    /// s after the first message.
    Seek(f64),
    /// How fast.
    Rate(f64),
    /// Ends.
    Quit,
}

/// Standard input and the pause service, as one stream of controls.
pub fn controls(node: &Node) -> Result<Receiver<Control>> {
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
                    None => note!("'{line}' is not known; expected pause, resume, seek SECONDS, rate FACTOR, quit"),
                }
            }
        })
        .context("cannot start the thread that reads standard input")?;
    Ok(receiver)
}
