//! The one crate that knows ros2-client: arguments, parameters, quality of service, services, clock, diagnostics.
