//! Joint commands and states over motor buses.
//!
//! From the wire up:
//!
//! - [`Frame`]: a CAN or CAN FD frame; no operating system needed, like everything up to the emulated drive.
//! - [`Protocol`]: what a drive's frames say, from both ends. [`Mit`] is the layout of the MIT mini-cheetah's
//!   actuators; [`Registers`] that of moteus controllers (CAN FD register frames). No public protocol of the Vision
//!   60's drives exists: which one a robot speaks is this project's configuration.
//! - [`EmulatedDrive`]: the drive's end of a protocol with its law, watchdog, torque limit, latency and temperature,
//!   for tests and simulation.
//! - [`Link`]: something that frames go through without ever blocking: [`memory`] within a process, [`can::CanLink`]
//!   over Linux SocketCAN, [`Faulty`] around another, for tests.
//! - [`InertialUnit`]: an inertial unit that the cycle reads itself; [`CanInertialUnit`] and [`EmulatedInertialUnit`]
//!   are the two ends of one with frames of this project's own.
//! - [`JointBus`]: what the control cycle sees: twelve joints to read from and write to. [`DriveBus`] makes one of
//!   links and a protocol. The DDS backend of the same trait is `dds_bus` in the controller's node, because this crate
//!   knows no ROS.
#![cfg_attr(not(feature = "std"), no_std)]

mod drive;
mod emulated;
mod frame;
mod mit;
mod registers;

pub use drive::{DriveCommand, DriveLimits, DriveReply, DriveRequest, EncodeError, Protocol, Ranges};
pub use emulated::{DriveModel, EmulatedDrive};
pub use frame::Frame;
pub use mit::Mit;
pub use registers::Registers;

#[cfg(feature = "std")]
mod bus_health;
#[cfg(feature = "std")]
pub mod can;
#[cfg(feature = "std")]
mod can_lock;
#[cfg(feature = "std")]
mod config;
#[cfg(feature = "std")]
mod contract;
#[cfg(feature = "std")]
mod drive_bus;
#[cfg(feature = "std")]
mod drive_protocol;
#[cfg(feature = "std")]
mod faulty;
#[cfg(feature = "std")]
mod inertial_unit;
#[cfg(feature = "std")]
mod link;
mod link_state;
#[cfg(feature = "std")]
pub mod memory;
#[cfg(feature = "std")]
mod readings;
#[cfg(feature = "std")]
mod reply_balance;

#[cfg(feature = "std")]
pub use bus_health::{BusHealth, LinkHealth};
#[cfg(feature = "std")]
pub use can_lock::{CanLock, CanLockError};
#[cfg(feature = "std")]
pub use config::{BusConfig, BusConfigError, InertialWiring, JointWiring, ProtocolName};
#[cfg(feature = "std")]
pub use contract::{ContractBench, check_contract};
#[cfg(feature = "std")]
pub use drive_bus::{DriveBus, JointBus};
#[cfg(feature = "std")]
pub use drive_protocol::DriveProtocol;
#[cfg(feature = "std")]
pub use faulty::{Faults, Faulty};
#[cfg(feature = "std")]
pub use inertial_unit::{CanInertialUnit, EmulatedInertialUnit, InertialFrames, InertialUnit};
#[cfg(feature = "std")]
pub use link::{Incoming, Link, LinkError};
#[cfg(feature = "std")]
pub use readings::Readings;
