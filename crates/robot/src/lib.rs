//! A quadruped's description: its model, legs, toes, mirror, nominal posture, gains and limits.
