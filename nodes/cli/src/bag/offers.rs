//! What the topics of a played bag are offered with.

use ::bag::{Bag, BagTopic, Durability, Liveliness, Offer, Reliability};
use anyhow::{Context, Result};
use ros::{Node, Promises, Qos, RawPublisher};
use std::path::Path;

/// Messages kept for reliable subscriptions at least.
const LEAST_DEPTH: usize = 10;
/// Messages kept for late subscribers where nothing says how many, at most.
const MOST_KEPT: usize = 1000;

/// A topic that is played.
pub struct Offered {
    /// Sends its messages.
    pub publisher: RawPublisher,
    /// Messages from before the start that are sent first.
    pub kept: usize,
    /// It has been reported that a message of it could not be sent.
    pub reported: bool,
}

impl Offered {
    /// One for each topic of the bag that is wanted; a line for each that cannot be played.
    pub fn all(
        node: &Node,
        bag: &Bag,
        overrides: &[(String, Offer)],
        reliable: bool,
        wanted: impl Fn(&str) -> bool,
    ) -> Result<Vec<Option<Offered>>> {
        for (topic, _) in overrides {
            if bag.topic(topic).is_none() {
                note!("the overrides name {topic}, which is not in {}", bag.path().display());
            }
        }
        bag.topics()
            .iter()
            .map(|topic| {
                if !wanted(&topic.name) {
                    return Ok(None);
                }
                if let Some(reason) = unplayable(topic) {
                    note!("{} is not played: {reason}", topic.name);
                    return Ok(None);
                }
                let asked = overrides.iter().find(|(name, _)| *name == topic.name).map(|(_, offer)| *offer);
                let kept = asked.map_or_else(|| kept(topic), kept_as_asked);
                let qos = asked.map_or_else(|| recorded(topic, reliable), stated);
                let publisher = node.raw_publisher(&topic.name, &topic.type_name, qos)?;
                Ok(Some(Offered { publisher, kept, reported: false }))
            })
            .collect()
    }
}

/// Reads a file of overrides.
pub fn overrides(file: &Path) -> Result<Vec<(String, Offer)>> {
    let text = std::fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
    Offer::overrides_from_yaml(&text).map_err(|reason| anyhow::anyhow!("{}: {reason}", file.display()))
}

fn unplayable(topic: &BagTopic) -> Option<String> {
    if topic.encoding != "cdr" {
        return Some(format!("its messages are in '{}', and ROS 2 takes CDR", topic.encoding));
    }
    let parts: Vec<&str> = topic.type_name.split('/').collect();
    match parts.as_slice() {
        [package, "msg", name] if !package.is_empty() && !name.is_empty() => None,
        _ => Some(format!("its type is '{}', expected package/msg/Type", topic.type_name)),
    }
}

/// Messages that the recorded publishers kept for late subscribers. Which of several sent a message no bag says: all
/// of them are kept then, so that the last of each is among them.
fn kept(topic: &BagTopic) -> usize {
    let Some(offer) = Offer::for_all(&topic.offers).filter(|offer| offer.durability == Durability::TransientLocal)
    else {
        return 0;
    };
    let depth = offer.depth.map_or(MOST_KEPT, |depth| depth as usize);
    let sent = usize::try_from(topic.messages).unwrap_or(MOST_KEPT).min(MOST_KEPT);
    if topic.offers.len() > 1 { depth.max(sent) } else { depth }
}

fn kept_as_asked(offer: Offer) -> usize {
    let latched = offer.durability == Durability::TransientLocal;
    if latched { offer.depth.map_or(MOST_KEPT, |depth| depth as usize) } else { 0 }
}

/// Serves everyone whom one of the recorded publishers served.
fn recorded(topic: &BagTopic, reliable: bool) -> Qos {
    let offer = Offer::for_all(&topic.offers).unwrap_or_default();
    let depth = offer.depth.map_or(MOST_KEPT, |depth| depth as usize);
    // A reliable publisher serves best-effort subscriptions as well.
    match offer.durability {
        Durability::TransientLocal => Qos::stated(true, true, Some(kept(topic).max(1)), promises(&offer)),
        Durability::Volatile if reliable => Qos::stated(true, false, None, promises(&offer)),
        Durability::Volatile => Qos::stated(true, false, Some(depth.max(LEAST_DEPTH)), promises(&offer)),
    }
}

/// Exactly as a file asks for it.
fn stated(offer: Offer) -> Qos {
    let (reliable, latched) =
        (offer.reliability == Reliability::Reliable, offer.durability == Durability::TransientLocal);
    Qos::stated(reliable, latched, offer.depth.map(|depth| depth as usize), promises(&offer))
}

fn promises(offer: &Offer) -> Promises {
    Promises {
        deadline: offer.deadline,
        lifespan: offer.lifespan,
        manual_liveliness: offer.liveliness == Liveliness::ManualByTopic,
        lease: offer.lease,
    }
}
