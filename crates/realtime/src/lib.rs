//! The periodic real-time loop: scheduling, latency histogram, allocation guard.
