//! A library of gaits: a grid of requests, solved row by row, each from its neighbours' solutions; and what lies
//! between the grid's points, by interpolation, with the violation that this costs stated.
//!
//! A library is a text file, one line a gait, so that it can be written while it is solved and taken up again after an
//! interruption: a header with the robot and the grid, then one line for each point in any order. Every line begins
//! with the CRC-32 of the rest, in hexadecimal.
//!
//! A grid that goes aside or turns, or whose base leans or is on a sideways slope, is solved as strides: both steps of
//! each, by the full-order program. What goes or turns to the right is the mirror image of what does so to the left,
//! where the grid has both.
//!
//! This module opens no file and starts no thread: [`Library::solve_row`] can be called for different rows at once.

mod contents;
mod error;
mod file;
mod find;
mod grid;

pub use contents::{Entry, Library};
pub use error::LibraryError;
pub use file::{FORMAT, VERSION, VERSION_STRIDES};
pub use find::Found;
pub use grid::{Axis, Field, Grid, MOST_POINTS};
