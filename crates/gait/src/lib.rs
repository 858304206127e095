//! Bézier outputs, step phase, mirror, and the gait file.
