//! Pictures and pages of a walk: phase portraits, gait tiles, torque bars.
