//! Joint commands and states over motor buses: the codec, the bus trait and its backends.
