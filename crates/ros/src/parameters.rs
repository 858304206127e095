//! Typed parameters: declared with description, range and validator; set from the command line, from files and at run
//! time.

mod declared;
mod file;
mod services;
mod store;
mod value;

pub use declared::{Parameter, ParameterBuilder};
pub(crate) use file::{Override, overrides_from_yaml};
pub(crate) use store::{Changes, Store};
pub use value::{ParameterType, ParameterValue, Ranged};

#[cfg(test)]
mod tests;
