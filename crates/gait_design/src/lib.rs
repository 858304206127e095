//! Gait generation: transcription of the decomposed dynamics into a nonlinear program.
