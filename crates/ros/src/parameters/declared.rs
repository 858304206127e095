//! A parameter as the program that declares it has it.

use std::marker::PhantomData;
use std::sync::Arc;

use settings::Quantity;
use tandem_msgs::rcl_interfaces as wire;

use super::store::{Entry, Store};
use super::value::{ParameterType, Ranged};
use crate::RosError;

/// A declared parameter. Reading it takes a lock: not for a control thread. Clones are the same parameter.
#[derive(Clone)]
pub struct Parameter<T> {
    store: Arc<Store>,
    name: String,
    default: T,
}

impl<T: ParameterType> Parameter<T> {
    /// The present value.
    #[must_use]
    pub fn get(&self) -> T {
        // Declared with this type and never undeclared, so the default is never used.
        self.store.get(&self.name).and_then(|value| T::from_value(&value)).unwrap_or_else(|| self.default.clone())
    }

    /// Sets it from inside the program, through the same checks as from outside.
    ///
    /// # Errors
    /// The check that refused the value.
    pub fn set(&self, value: T) -> Result<(), String> {
        self.store.set(&[(self.name.clone(), value.into_value())])
    }
}

/// A parameter that is about to be declared: see [`Node::parameter`](crate::Node::parameter).
#[must_use = "call declare()"]
pub struct ParameterBuilder<T> {
    store: Arc<Store>,
    default: T,
    entry: Entry,
    kind: PhantomData<T>,
}

impl<T: ParameterType> ParameterBuilder<T> {
    pub(crate) fn new(store: Arc<Store>, name: &str, default: T) -> Self {
        let value = default.clone().into_value();
        ParameterBuilder {
            store,
            default,
            entry: Entry {
                descriptor: wire::ParameterDescriptor {
                    name: name.to_string(),
                    r#type: value.type_number(),
                    ..Default::default()
                },
                value,
                checks: Vec::new(),
            },
            kind: PhantomData,
        }
    }

    /// What it is, with its unit.
    pub fn description(mut self, text: &str) -> Self {
        self.entry.descriptor.description = text.to_string();
        self
    }

    /// Can be set only when the node is started.
    pub fn read_only(mut self) -> Self {
        self.entry.descriptor.read_only = true;
        self
    }

    /// A check beyond the range; its error reaches whoever sets the parameter. `rule` says it for people.
    pub fn validate(mut self, rule: &str, check: impl Fn(&T) -> Result<(), String> + Send + Sync + 'static) -> Self {
        self.entry.descriptor.additional_constraints = rule.to_string();
        self.entry.checks.push(Box::new(move |value| match T::from_value(value) {
            Some(value) => check(&value),
            None => Ok(()), // the type is checked before
        }));
        self
    }

    /// Declares it. Its value is the default, or what the command line or a file says.
    ///
    /// # Errors
    /// When a value given at the start is of another type or out of range, or the name is taken.
    pub fn declare(self) -> Result<Parameter<T>, RosError> {
        let name = self.entry.descriptor.name.clone();
        self.store.declare(&name, self.entry)?;
        Ok(Parameter { store: self.store, name, default: self.default })
    }
}

impl<T: Ranged> ParameterBuilder<T> {
    /// Least and greatest value of a plain number. NaN is in no range.
    pub fn range(self, from: T, to: T) -> Self {
        self.range_in(from, to, "")
    }

    /// Least and greatest value, and their unit. NaN is in no range.
    pub fn range_in(mut self, from: T, to: T, unit: &'static str) -> Self {
        T::describe(&from, &to, &mut self.entry.descriptor);
        self.entry.checks.push(Box::new(move |value| match T::from_value(value) {
            Some(value) if value >= from && value <= to => Ok(()),
            Some(value) => {
                let (to, value) = (Quantity(&to, unit), Quantity(value, unit));
                Err(format!("expected a value from {from} to {to}, got {value}"))
            }
            None => Ok(()), // the type is checked before
        }));
        self
    }
}
