//! What can go wrong, each with the thing named and what to do.

use std::time::Duration;

/// An error of this crate.
#[derive(Debug, thiserror::Error)]
pub enum RosError {
    /// A command line argument.
    #[error("argument {argument:?}: {reason}")]
    Argument {
        /// The argument as given.
        argument: String,
        /// What was expected.
        reason: String,
    },
    /// An environment variable.
    #[error("environment variable {name}={value}: {reason}")]
    Environment {
        /// The variable.
        name: &'static str,
        /// Its value.
        value: String,
        /// What was expected.
        reason: String,
    },
    /// A name of a node, topic, service or parameter.
    #[error("name {name:?}: {reason}")]
    Name {
        /// The name as given.
        name: String,
        /// What was expected.
        reason: String,
    },
    /// A parameter's value, from the command line, a file or a service.
    #[error("parameter {name:?}: {reason}")]
    Parameter {
        /// The parameter.
        name: String,
        /// What was expected.
        reason: String,
    },
    /// DDS Security is asked for and cannot be had.
    #[error("DDS Security, enclave {enclave}: {reason}")]
    Security {
        /// The enclave's name.
        enclave: String,
        /// What is missing.
        reason: String,
    },
    /// The middleware did not create something.
    #[error("cannot create {what}: {reason}")]
    Create {
        /// What was to be created.
        what: String,
        /// The middleware's reason.
        reason: String,
    },
    /// The node has been shut down.
    #[error("{what}: the node has been shut down")]
    ShutDown {
        /// What was attempted.
        what: String,
    },
}

/// A message was not sent.
#[derive(Debug, thiserror::Error)]
pub enum PublishError {
    /// A reliable subscriber has fallen behind a publisher that keeps all ([`Qos::keep_all`](crate::Qos::keep_all)).
    #[error("topic {topic}: a reliable subscriber does not keep up, the message is dropped")]
    Full {
        /// The topic.
        topic: String,
    },
    /// The node has been shut down.
    #[error("topic {topic}: the node has been shut down")]
    ShutDown {
        /// The topic.
        topic: String,
    },
    /// Anything else that the middleware reports.
    #[error("topic {topic}: {reason}")]
    Middleware {
        /// The topic.
        topic: String,
        /// The middleware's reason.
        reason: String,
    },
}

/// A service call without a response.
#[derive(Debug, thiserror::Error)]
pub enum CallError {
    /// No server was found in time.
    #[error(
        "service {service}: no server found within {waited:?} (is the node running, with the same ROS_DOMAIN_ID and namespace?)"
    )]
    NoServer {
        /// The service.
        service: String,
        /// How long was waited.
        waited: Duration,
    },
    /// The server did not answer in time.
    #[error("service {service}: no response within {waited:?}")]
    NoResponse {
        /// The service.
        service: String,
        /// How long was waited.
        waited: Duration,
    },
    /// The node has been shut down.
    #[error("service {service}: the node has been shut down")]
    ShutDown {
        /// The service.
        service: String,
    },
    /// Anything else that the middleware reports.
    #[error("service {service}: {reason}")]
    Middleware {
        /// The service.
        service: String,
        /// The middleware's reason.
        reason: String,
    },
}
