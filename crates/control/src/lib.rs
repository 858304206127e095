//! The tracking law, step switching, limits and the safety state machine as one pure step.
