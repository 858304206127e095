//! A node's parameters: which there are, what they hold and who is notified of changes.

use std::collections::BTreeMap;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tandem_msgs::rcl_interfaces as wire;

use super::file::Override;
use super::value::{ParameterValue, TYPE_NAMES};
use crate::RosError;

/// How long after its start a node's parameters are taken to be declared, if it does not say when.
const DECLARING: Duration = Duration::from_secs(1);

pub(super) type Check = Box<dyn Fn(&ParameterValue) -> Result<(), String> + Send + Sync>;

pub(super) struct Entry {
    pub value: ParameterValue,
    pub descriptor: wire::ParameterDescriptor,
    pub checks: Vec<Check>,
}

impl Entry {
    pub(super) fn check(&self, value: &ParameterValue) -> Result<(), String> {
        if value.type_number() != self.descriptor.r#type {
            let expected = TYPE_NAMES[usize::from(self.descriptor.r#type)];
            let hint = match (value, expected) {
                (ParameterValue::Integer(number), "double") => format!("; write {number}.0"),
                _ => String::new(),
            };
            return Err(format!("expected {expected}, got {} {value}{hint}", value.type_name()));
        }
        self.checks.iter().try_for_each(|check| check(value))
    }
}

/// What happened to parameters, for `/parameter_events`.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Changes {
    pub(crate) new: Vec<(String, ParameterValue)>,
    pub(crate) changed: Vec<(String, ParameterValue)>,
}

impl Changes {
    pub(crate) fn into_event(self, node: String, stamp: tandem_msgs::builtin_interfaces::Time) -> wire::ParameterEvent {
        let list = |items: Vec<(String, ParameterValue)>| {
            items.into_iter().map(|(name, value)| wire::Parameter { name, value: value.to_wire() }).collect()
        };
        wire::ParameterEvent {
            stamp,
            node,
            new_parameters: list(self.new),
            changed_parameters: list(self.changed),
            deleted_parameters: Vec::new(),
        }
    }
}

/// A node's parameters.
pub(crate) struct Store {
    node: String,
    overrides: BTreeMap<String, ParameterValue>,
    declared: Mutex<BTreeMap<String, Entry>>,
    on_change: Box<dyn Fn(Changes) + Send + Sync>,
    started: Instant,
    complete: Mutex<bool>,
    completed: Condvar,
}

impl Store {
    /// `node` is the full name. Of the overrides that match it the later wins.
    pub(crate) fn new(
        node: String,
        overrides: &[Override],
        on_change: impl Fn(Changes) + Send + Sync + 'static,
    ) -> Self {
        let overrides = overrides
            .iter()
            .filter(|candidate| matches(&candidate.node, &node))
            .map(|candidate| (candidate.name.clone(), candidate.value.clone()))
            .collect();
        Store {
            node,
            overrides,
            declared: Mutex::default(),
            on_change: Box::new(on_change),
            started: Instant::now(),
            complete: Mutex::default(),
            completed: Condvar::new(),
        }
    }

    /// All parameters are declared.
    pub(crate) fn complete(&self) {
        *self.complete.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.completed.notify_all();
    }

    /// Waits until all are declared: a node that is starting shall not deny a parameter that it will have.
    pub(crate) fn wait_until_complete(&self) {
        let complete = self.complete.lock().unwrap_or_else(PoisonError::into_inner);
        let left = DECLARING.saturating_sub(self.started.elapsed());
        // Whoever says nothing in time has declared all.
        let _ = self.completed.wait_timeout_while(complete, left, |complete| !*complete);
    }

    pub(super) fn declared(&self) -> MutexGuard<'_, BTreeMap<String, Entry>> {
        // Entries are replaced whole: a panic elsewhere leaves no half-written value.
        self.declared.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn declare(&self, name: &str, mut entry: Entry) -> Result<(), RosError> {
        let wrong = |reason: String| RosError::Parameter {
            name: name.to_string(),
            reason: format!("{reason} (node {})", self.node),
        };
        if let Some(value) = self.overrides.get(name) {
            entry.check(value).map_err(wrong)?;
            entry.value = value.clone();
        } else {
            entry.check(&entry.value).map_err(|reason| wrong(format!("its default: {reason}")))?;
        }
        let value = entry.value.clone();
        let mut declared = self.declared();
        if declared.contains_key(name) {
            return Err(wrong("declared twice".to_string()));
        }
        declared.insert(name.to_string(), entry);
        drop(declared);
        (self.on_change)(Changes { new: vec![(name.to_string(), value)], changed: Vec::new() });
        Ok(())
    }

    pub(crate) fn get(&self, name: &str) -> Option<ParameterValue> {
        self.declared().get(name).map(|entry| entry.value.clone())
    }

    /// Overrides for this node that no parameter took.
    pub(crate) fn unused_overrides(&self) -> Vec<String> {
        let declared = self.declared();
        self.overrides.keys().filter(|name| !declared.contains_key(*name)).cloned().collect()
    }

    /// All or nothing.
    pub(crate) fn set(&self, parameters: &[(String, ParameterValue)]) -> Result<(), String> {
        let mut declared = self.declared();
        for (name, value) in parameters {
            let entry = declared.get(name).ok_or_else(|| {
                let known: Vec<&str> = declared.keys().map(String::as_str).collect();
                format!("parameter {name:?} is not declared; this node has {}", known.join(", "))
            })?;
            if entry.descriptor.read_only {
                return Err(format!("parameter {name:?} is read-only: set it when the node is started"));
            }
            entry.check(value).map_err(|reason| format!("parameter {name:?}: {reason}"))?;
        }
        for (name, value) in parameters {
            if let Some(entry) = declared.get_mut(name) {
                entry.value = value.clone();
            }
        }
        drop(declared);
        (self.on_change)(Changes { new: Vec::new(), changed: parameters.to_vec() });
        Ok(())
    }
}

/// Whether a node pattern of a parameter file (`/a/*/b`, `/**`) matches a full node name.
pub(super) fn matches(pattern: &str, node: &str) -> bool {
    fn parts(pattern: &[&str], node: &[&str]) -> bool {
        match (pattern.split_first(), node.split_first()) {
            (None, None) => true,
            (Some((&"**", rest)), _) => (0..=node.len()).any(|skip| parts(rest, &node[skip..])),
            (Some((&"*", rest)), Some((_, others))) => parts(rest, others),
            (Some((name, rest)), Some((other, others))) => name == other && parts(rest, others),
            _ => false,
        }
    }
    let split = |name: &'_ str| name.split('/').filter(|part| !part.is_empty()).map(str::to_string).collect::<Vec<_>>();
    let (pattern, node) = (split(pattern), split(node));
    parts(&pattern.iter().map(String::as_str).collect::<Vec<_>>(), &node.iter().map(String::as_str).collect::<Vec<_>>())
}
