use std::io;

/// What a control thread asks of the system.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RealtimeRequest {
    /// Priority of SCHED_FIFO, 1 to 99; none leaves the scheduling as it is.
    pub priority: Option<u8>,
    /// Processor to stay on; none lets the system choose.
    pub core: Option<usize>,
    /// Lock the process's memory, present and future.
    pub lock_memory: bool,
    /// Touch this much of the stack beforehand, bytes.
    pub prefault_stack_bytes: usize,
}

impl Default for RealtimeRequest {
    fn default() -> Self {
        Self { priority: Some(80), core: None, lock_memory: true, prefault_stack_bytes: 256 * 1024 }
    }
}

/// Something that the system refused.
#[derive(Debug, thiserror::Error)]
pub enum Warning {
    /// No real-time scheduling.
    #[error(
        "real-time scheduling (SCHED_FIFO {priority}) refused: {source}. Cycles will come late under load. Grant CAP_SYS_NICE to the process, or `rtprio {priority}` to its user in /etc/security/limits.conf, or LimitRTPRIO={priority} in its systemd unit"
    )]
    Scheduling {
        /// The priority asked for.
        priority: u8,
        /// Why.
        source: io::Error,
    },
    /// Not pinned.
    #[error(
        "pinning the control thread to processor {core} refused: {source}. Name one of the machine's processors, or none"
    )]
    Core {
        /// The processor asked for.
        core: usize,
        /// Why.
        source: io::Error,
    },
    /// Memory not locked.
    #[error(
        "locking memory refused: {source}. A page fault can delay a cycle. Grant CAP_IPC_LOCK to the process, or `memlock unlimited` to its user in /etc/security/limits.conf, or LimitMEMLOCK=infinity in its systemd unit"
    )]
    LockMemory {
        /// Why.
        source: io::Error,
    },
}

impl RealtimeRequest {
    /// Asks for everything, for the calling thread (memory: for the process). What the system refuses comes back, one
    /// warning each; the thread runs on without it.
    pub fn apply(&self) -> Vec<Warning> {
        let mut warnings = Vec::new();
        if self.lock_memory
            // SAFETY: no pointer is passed.
            && unsafe { libc::mlockall(libc::MCL_CURRENT | libc::MCL_FUTURE) } != 0
        {
            warnings.push(Warning::LockMemory { source: io::Error::last_os_error() });
        }
        if let Some(core) = self.core
            && let Err(source) = pin(core)
        {
            warnings.push(Warning::Core { core, source });
        }
        if let Some(priority) = self.priority {
            // SAFETY: all zero is a valid sched_param; the pointer is to a live one.
            let result = unsafe {
                let mut parameters: libc::sched_param = std::mem::zeroed();
                parameters.sched_priority = priority.into();
                libc::pthread_setschedparam(libc::pthread_self(), libc::SCHED_FIFO, &parameters)
            };
            if result != 0 {
                warnings.push(Warning::Scheduling { priority, source: io::Error::from_raw_os_error(result) });
            }
        }
        prefault_stack(self.prefault_stack_bytes);
        warnings
    }
}

/// Gives ordinary threads of this process, those whose names begin with one of `names`, the real-time priority
/// `priority`, so that a busy machine does not hold them up. Threads that they start are ordinary again. The number of
/// threads that have it now.
///
/// # Errors
/// The system's refusal.
pub fn raise_threads(names: &[&str], priority: u8) -> Result<usize, Warning> {
    let refused = |source| Warning::Scheduling { priority, source };
    let mut raised = 0;
    for task in std::fs::read_dir("/proc/self/task").map_err(refused)? {
        let task = task.map_err(refused)?;
        // A thread may end meanwhile.
        let Ok(name) = std::fs::read_to_string(task.path().join("comm")) else { continue };
        let Some(id) = task.file_name().to_str().and_then(|id| id.parse::<libc::pid_t>().ok()) else { continue };
        if !names.iter().any(|wanted| name.starts_with(wanted)) {
            continue;
        }
        // SAFETY: all zero is a valid sched_param; the pointer is to a live one.
        let result = unsafe {
            let mut parameters: libc::sched_param = std::mem::zeroed();
            parameters.sched_priority = priority.into();
            libc::sched_setscheduler(id, libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK, &parameters)
        };
        if result != 0 {
            return Err(refused(io::Error::last_os_error()));
        }
        raised += 1;
    }
    Ok(raised)
}

fn pin(core: usize) -> io::Result<()> {
    if core >= libc::CPU_SETSIZE as usize {
        return Err(io::Error::from_raw_os_error(libc::EINVAL));
    }
    // SAFETY: all zero is an empty set; the core is within it; the pointer is to a live set of the stated size.
    let result = unsafe {
        let mut set: libc::cpu_set_t = std::mem::zeroed();
        libc::CPU_SET(core, &mut set);
        libc::sched_setaffinity(0, size_of::<libc::cpu_set_t>(), &set)
    };
    if result == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

/// Writes to every page of the stack that the loop may come to use, a page at a time on the way down.
#[inline(never)]
fn prefault_stack(bytes: usize) {
    const PAGE: usize = 4096;
    let mut page = [0_u8; PAGE];
    std::hint::black_box(&mut page);
    if bytes > PAGE {
        prefault_stack(bytes - PAGE);
    }
    // Keeps the frame alive over the call, so that the calls cannot share one.
    std::hint::black_box(&page);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_refused_is_named_with_what_to_grant() {
        let request =
            RealtimeRequest { priority: None, core: Some(1_000_000), lock_memory: false, prefault_stack_bytes: 65536 };
        let warnings = std::thread::spawn(move || request.apply()).join().unwrap();
        assert_eq!(warnings.len(), 1);
        assert!(warnings[0].to_string().contains("processor 1000000"), "{}", warnings[0]);
    }

    #[test]
    fn nothing_asked_nothing_refused() {
        let request = RealtimeRequest { priority: None, core: None, lock_memory: false, prefault_stack_bytes: 0 };
        assert!(request.apply().is_empty());
    }

    #[test]
    fn granted_or_refused_real_time_scheduling_is_as_reported() {
        std::thread::spawn(|| {
            let request =
                RealtimeRequest { priority: Some(1), core: Some(0), lock_memory: false, prefault_stack_bytes: 65536 };
            let warnings = request.apply();
            // SAFETY: no pointer is passed.
            let policy = unsafe { libc::sched_getscheduler(0) };
            let refused = warnings.iter().any(|w| matches!(w, Warning::Scheduling { .. }));
            assert_eq!(policy == libc::SCHED_FIFO, !refused, "policy {policy}, {warnings:?}");
        })
        .join()
        .unwrap();
    }

    #[test]
    fn threads_are_raised_by_their_name_and_theirs_are_not() {
        let (go, wait) = std::sync::mpsc::channel::<()>();
        let policy = || {
            // SAFETY: no pointer is passed.
            unsafe { libc::sched_getscheduler(0) & !libc::SCHED_RESET_ON_FORK }
        };
        let named = std::thread::Builder::new().name("raise_me".into()).spawn(move || {
            wait.recv().unwrap();
            (policy(), std::thread::spawn(policy).join().unwrap())
        });
        let raised = loop {
            // A thread names itself, some time after it was started.
            let raised = super::raise_threads(&["raise_me"], 1);
            if !matches!(raised, Ok(0)) {
                break raised;
            }
        };
        go.send(()).unwrap();
        let expected = if raised.is_ok() { libc::SCHED_FIFO } else { libc::SCHED_OTHER };
        assert_eq!(named.unwrap().join().unwrap(), (expected, libc::SCHED_OTHER), "{raised:?}");
    }
}
