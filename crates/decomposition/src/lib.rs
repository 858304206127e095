//! The quadruped as two bipeds coupled by a connection wrench, and its recomposition.
