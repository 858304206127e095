//! One master for each CAN interface of a host.

use std::io;
use std::os::linux::net::SocketAddrExt as _;
use std::os::unix::net::{SocketAddr, UnixListener};

/// Held while its process lives: the kernel lets go of it at the process's death, whatever its cause. It is a name
/// among the abstract Unix sockets, which are the network namespace's own, as CAN interfaces are.
#[derive(Debug)]
pub struct CanLock {
    _name: UnixListener,
    /// Says whose the interface is, for the one that is refused.
    _holder: Option<UnixListener>,
}

/// Why an interface cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum CanLockError {
    /// Another process is its master.
    #[error("{interface} has a master already, {holder}: stop that controller first")]
    Held {
        /// The interface.
        interface: String,
        /// Its master, as far as is known.
        holder: String,
    },
    /// The system refused.
    #[error("{interface} cannot be locked: {source}")]
    System {
        /// The interface.
        interface: String,
        /// Why.
        source: io::Error,
    },
}

fn name(interface: &str) -> String {
    format!("tandem-can-master/{interface}")
}

fn bind(name: &str) -> io::Result<UnixListener> {
    UnixListener::bind_addr(&SocketAddr::from_abstract_name(name)?)
}

/// The process that says to be the master, in the kernel's list of this network namespace's sockets.
fn holder(interface: &str) -> Option<u32> {
    let prefix = format!("@{}/pid/", name(interface));
    let sockets = std::fs::read_to_string("/proc/net/unix").ok()?;
    sockets.lines().find_map(|line| line.rsplit_once(' ')?.1.strip_prefix(&prefix)?.parse().ok())
}

impl CanLock {
    /// Takes the interface, such as `can0`.
    ///
    /// # Errors
    /// Where another process, or another lock in this one, has it.
    pub fn take(interface: &str) -> Result<Self, CanLockError> {
        let held = bind(&name(interface)).map_err(|source| match source.kind() {
            io::ErrorKind::AddrInUse => CanLockError::Held {
                interface: interface.into(),
                holder: holder(interface).map_or("of unknown process".into(), |pid| format!("process {pid}")),
            },
            _ => CanLockError::System { interface: interface.into(), source },
        })?;
        let holder = bind(&format!("{}/pid/{}", name(interface), std::process::id())).ok();
        Ok(Self { _name: held, _holder: holder })
    }
}
