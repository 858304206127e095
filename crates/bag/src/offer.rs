//! What a topic's publishers offered, all policies of each, and one offer that serves everyone whom they served.

use std::time::Duration;

use serde_yaml_ng::Value;

use crate::{Durability, Qos, Reliability};

/// How a publisher shows that it lives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Liveliness {
    /// The middleware says so.
    #[default]
    Automatic,
    /// The program says so, for each topic.
    ManualByTopic,
}

/// What one publisher offered, or what a file of overrides asks for. `None` stands for no limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Offer {
    /// Whether every message must arrive.
    pub reliability: Reliability,
    /// Whether a late subscriber gets the last messages.
    pub durability: Durability,
    /// How many messages are kept.
    pub depth: Option<u32>,
    /// Longest time from one message to the next.
    pub deadline: Option<Duration>,
    /// How long a message is of use.
    pub lifespan: Option<Duration>,
    /// How it shows that it lives.
    pub liveliness: Liveliness,
    /// Longest time between two signs of life.
    pub lease: Option<Duration>,
}

/// More messages than this are not kept for late subscribers.
const LARGEST_DEPTH: u64 = 100_000;

impl Default for Offer {
    /// ROS 2's default: reliable, volatile, ten messages.
    fn default() -> Self {
        Offer {
            reliability: Reliability::Reliable,
            durability: Durability::Volatile,
            depth: Some(10),
            deadline: None,
            lifespan: None,
            liveliness: Liveliness::Automatic,
            lease: None,
        }
    }
}

impl From<Offer> for Qos {
    fn from(offer: Offer) -> Qos {
        let depth = offer.depth.unwrap_or(LARGEST_DEPTH as u32);
        Qos { reliability: offer.reliability, durability: offer.durability, depth }
    }
}

impl Offer {
    /// The offer that every subscriber accepts who accepted one of `offers`; `None` of none. What is kept for late
    /// subscribers is as much as all of them kept together.
    pub fn for_all(offers: &[Offer]) -> Option<Offer> {
        let shortest = |of: fn(&Offer) -> Option<Duration>| offers.iter().filter_map(of).min();
        let latched = offers.iter().filter(|offer| offer.durability == Durability::TransientLocal);
        let kept = latched.clone().try_fold(0_u32, |sum, offer| Some(sum.saturating_add(offer.depth?)));
        let deepest = offers.iter().map(|offer| offer.depth).try_fold(0, |most, depth| Some(most.max(depth?)));
        let is_latched = latched.count() > 0;
        offers.first().map(|_| Offer {
            reliability: match offers.iter().any(|offer| offer.reliability == Reliability::Reliable) {
                true => Reliability::Reliable,
                false => Reliability::BestEffort,
            },
            durability: if is_latched { Durability::TransientLocal } else { Durability::Volatile },
            depth: if is_latched { kept } else { deepest },
            deadline: shortest(|offer| offer.deadline),
            lifespan: offers
                .iter()
                .map(|offer| offer.lifespan)
                .try_fold(Duration::ZERO, |most, span| Some(most.max(span?))),
            liveliness: offers.iter().map(|offer| offer.liveliness).max().unwrap_or_default(),
            lease: shortest(|offer| offer.lease),
        })
    }

    /// Reads what rosbag2 writes: a YAML list whose words are names (version 9) or numbers (before). A profile that
    /// cannot be read is left out.
    pub(crate) fn list_from_yaml(text: &str) -> Vec<Offer> {
        serde_yaml_ng::from_str(text).map_or(Vec::new(), |value| Offer::list_from_yaml_value(&value))
    }

    /// As it stands in metadata.yaml: a list since version 9, a text that holds the list before.
    pub(crate) fn list_from_yaml_value(value: &Value) -> Vec<Offer> {
        match value {
            Value::String(text) => serde_yaml_ng::from_str::<Value>(text)
                .ok()
                .filter(Value::is_sequence)
                .map_or(Vec::new(), |value| Offer::list_from_yaml_value(&value)),
            Value::Sequence(profiles) => {
                profiles.iter().filter_map(|profile| Offer::from_recorded(profile).ok()).collect()
            }
            _ => Vec::new(),
        }
    }

    /// A recorded profile says at least how reliable and how durable it is.
    fn from_recorded(profile: &Value) -> Result<Offer, String> {
        for needed in ["reliability", "durability"] {
            profile.get(needed).ok_or_else(|| format!("{needed} is missing"))?;
        }
        Offer::from_profile(profile)
    }

    /// A file of overrides, as `ros2 bag play --qos-profile-overrides-path` takes it: topics, and under each the
    /// policies that are not ROS 2's default.
    ///
    /// # Errors
    /// The topic, the policy, what stands there and what was expected.
    pub fn overrides_from_yaml(text: &str) -> Result<Vec<(String, Offer)>, String> {
        let document: Value = serde_yaml_ng::from_str(text).map_err(|error| format!("this is not YAML: {error}"))?;
        let topics = match &document {
            Value::Mapping(topics) => topics,
            Value::Null => return Ok(Vec::new()),
            _ => return Err("expected topics, and under each its policies".into()),
        };
        topics
            .iter()
            .map(|(topic, profile)| {
                let topic = topic.as_str().ok_or("a topic's name is no text")?;
                if !topic.starts_with('/') {
                    return Err(format!("'{topic}': expected a topic's full name, which begins with /"));
                }
                let offer = Offer::from_profile(profile).map_err(|reason| format!("{topic}: {reason}"))?;
                Ok((topic.to_owned(), offer))
            })
            .collect()
    }

    fn from_profile(profile: &Value) -> Result<Offer, String> {
        let Value::Mapping(policies) = profile else {
            return Err("expected policies such as 'reliability: reliable'".into());
        };
        let mut offer = Offer::default();
        let mut keep_all = false;
        for (name, value) in policies {
            let name = name.as_str().ok_or("a policy's name is no text")?;
            match name {
                "history" => {
                    keep_all =
                        word(name, value, &[("system_default", 0), ("keep_last", 1), ("keep_all", 2), ("unknown", 3)])?
                            == 2
                }
                "depth" => offer.depth = Some(depth(value)?),
                "reliability" => {
                    let words = [
                        ("system_default", 0),
                        ("reliable", 1),
                        ("best_effort", 2),
                        ("unknown", 3),
                        ("best_available", 4),
                    ];
                    let best_effort = word(name, value, &words)? == 2;
                    offer.reliability = if best_effort { Reliability::BestEffort } else { Reliability::Reliable };
                }
                "durability" => {
                    let words = [
                        ("system_default", 0),
                        ("transient_local", 1),
                        ("volatile", 2),
                        ("unknown", 3),
                        ("best_available", 4),
                    ];
                    let latched = word(name, value, &words)? == 1;
                    offer.durability = if latched { Durability::TransientLocal } else { Durability::Volatile };
                }
                "liveliness" => {
                    let words = [
                        ("system_default", 0),
                        ("automatic", 1),
                        ("manual_by_topic", 3),
                        ("unknown", 4),
                        ("best_available", 5),
                    ];
                    let manual = word(name, value, &words)? == 3;
                    offer.liveliness = if manual { Liveliness::ManualByTopic } else { Liveliness::Automatic };
                }
                "deadline" => offer.deadline = span(name, value)?,
                "lifespan" => offer.lifespan = span(name, value)?,
                "liveliness_lease_duration" => offer.lease = span(name, value)?,
                // Names on the wire are ROS 2's in any case.
                "avoid_ros_namespace_conventions" => {}
                other => {
                    return Err(format!(
                        "policy '{other}' is not known; expected history, depth, reliability, durability, deadline, lifespan, \
                         liveliness or liveliness_lease_duration"
                    ));
                }
            }
        }
        if keep_all {
            offer.depth = None;
        }
        Ok(offer)
    }
}

/// One of the words, or its number in bags before version 9.
fn word(name: &str, value: &Value, words: &[(&str, u64)]) -> Result<u64, String> {
    let found = words.iter().find(|(text, number)| value.as_str() == Some(text) || value.as_u64() == Some(*number));
    found.map(|(_, number)| *number).ok_or_else(|| {
        let known: Vec<&str> = words.iter().map(|(text, _)| *text).filter(|text| *text != "unknown").collect();
        format!("{name} is {}; expected {}", shown(value), known.join(", "))
    })
}

fn depth(value: &Value) -> Result<u32, String> {
    let depth = value.as_u64().ok_or_else(|| format!("depth is {}; expected a whole number", shown(value)))?;
    Ok(depth.clamp(1, LARGEST_DEPTH) as u32)
}

/// Nothing and rmw's "no limit" (at least 68 years) are no limit.
fn span(name: &str, value: &Value) -> Result<Option<Duration>, String> {
    const NO_LIMIT_S: u64 = 2_147_483_647;
    let part = |key: &str| value.get(key).map_or(Some(0), Value::as_u64);
    let (Value::Mapping(_), Some(sec), Some(nsec)) = (value, part("sec"), part("nsec")) else {
        return Err(format!("{name} is {}; expected {{sec: S, nsec: NS}}", shown(value)));
    };
    let span = Duration::from_secs(sec).saturating_add(Duration::from_nanos(nsec));
    Ok((!span.is_zero() && sec < NO_LIMIT_S).then_some(span))
}

fn shown(value: &Value) -> String {
    serde_yaml_ng::to_string(value).unwrap_or_default().trim_end().replace('\n', ", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_back() {
        for qos in [Qos::sensor(1), Qos::reliable(10), Qos::latched()] {
            assert_eq!(Offer::for_all(&Offer::list_from_yaml(&qos.to_yaml())).map(Qos::from), Some(qos));
        }
    }

    #[test]
    fn numbers_of_older_bags_are_understood() {
        let text = "- history: 1\n  depth: 7\n  reliability: 2\n  durability: 1\n  deadline: {sec: 0, nsec: 0}\n";
        let expected = Qos { reliability: Reliability::BestEffort, durability: Durability::TransientLocal, depth: 7 };
        let qos = |offers: Vec<Offer>| Offer::for_all(&offers).map(Qos::from);
        assert_eq!(qos(Offer::list_from_yaml(text)), Some(expected));
        for text in ["", "{{{", "words", "- 5", "- {reliability: 1}"] {
            assert_eq!(qos(Offer::list_from_yaml(text)), None, "{text}");
        }
        let nested = Value::from("'- words'");
        assert_eq!(qos(Offer::list_from_yaml_value(&nested)), None);
    }

    #[test]
    fn one_offer_serves_everyone_whom_mixed_ones_served() {
        let second = Some(Duration::from_secs(1));
        let sensor = Offer { reliability: Reliability::BestEffort, depth: Some(5), ..Offer::default() };
        let punctual = Offer { deadline: second, lifespan: second, lease: second, ..sensor };
        let both = Offer::for_all(&[sensor, Offer::default(), punctual]).unwrap();
        let expected = Offer { deadline: second, lease: second, ..Offer::default() };
        assert_eq!(both, expected);
        let latched = Offer { durability: Durability::TransientLocal, depth: Some(1), ..sensor };
        let all = Offer::for_all(&[latched, sensor, latched, latched]).unwrap();
        assert_eq!((all.depth, all.durability), (Some(3), Durability::TransientLocal));
        let endless = Offer { depth: None, ..latched };
        assert_eq!(Offer::for_all(&[latched, endless]).unwrap().depth, None);
        assert_eq!(Offer::for_all(&[]), None);
    }

    #[test]
    fn overrides_say_what_they_say_and_mistakes_are_named() {
        let text = "/a:\n  reliability: best_effort\n  history: keep_all\n/b: {durability: transient_local, depth: 3, \
                    deadline: {sec: 1, nsec: 5}, lifespan: {sec: 2147483647, nsec: 4294967295}, liveliness: manual_by_topic}\n";
        let overrides = Offer::overrides_from_yaml(text).unwrap();
        assert_eq!(overrides[0].1, Offer { reliability: Reliability::BestEffort, depth: None, ..Offer::default() });
        let b = Offer {
            durability: Durability::TransientLocal,
            depth: Some(3),
            deadline: Some(Duration::new(1, 5)),
            liveliness: Liveliness::ManualByTopic,
            ..Offer::default()
        };
        assert_eq!(overrides[1], ("/b".to_owned(), b));
        for (text, expected) in [
            ("/a: {reliability: sometimes}", "/a: reliability is sometimes; expected system_default, reliable"),
            ("/a: {reliable: true}", "/a: policy 'reliable' is not known"),
            ("/a: {depth: many}", "/a: depth is many"),
            ("/a: {deadline: 3}", "/a: deadline is 3; expected {sec: S, nsec: NS}"),
            ("a: {depth: 3}", "'a': expected a topic's full name"),
            ("/a: reliable", "/a: expected policies"),
            ("- 3", "expected topics"),
            ("{{", "not YAML"),
        ] {
            let error = Offer::overrides_from_yaml(text).unwrap_err();
            assert!(error.contains(expected), "{text}: {error}");
        }
    }
}
