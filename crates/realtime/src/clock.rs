use std::time::Duration;

/// Time on the system's monotonic clock (CLOCK_MONOTONIC), counted from an arbitrary instant that all processes share.
pub fn monotonic_now() -> Duration {
    let mut now = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: the pointer is to a live timespec. The call cannot fail for this clock.
    unsafe { libc::clock_gettime(libc::CLOCK_MONOTONIC, &mut now) };
    Duration::new(now.tv_sec as u64, now.tv_nsec as u32)
}

/// Sleeps until `at` on the monotonic clock; returns at once if that has passed.
pub(crate) fn sleep_until(at: Duration) {
    let until = libc::timespec { tv_sec: at.as_secs() as libc::time_t, tv_nsec: at.subsec_nanos().into() };
    loop {
        // SAFETY: the pointer is to a live timespec; no remainder is asked for with an absolute time.
        let result =
            unsafe { libc::clock_nanosleep(libc::CLOCK_MONOTONIC, libc::TIMER_ABSTIME, &until, std::ptr::null_mut()) };
        if result != libc::EINTR {
            return;
        }
    }
}
