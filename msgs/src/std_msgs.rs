//! Header and single values.

use crate::builtin_interfaces::Time;

messages! { "std_msgs";
    /// When and in which frame.
    Header {
        /// The time that the data belongs to.
        stamp: Time,
        /// The frame that it is given in.
        frame_id: std::string::String,
    }
    /// A colour: each 0 to 1, `a` 0 transparent.
    #[derive(Copy)]
    ColorRGBA {
        /// Red.
        r: f32,
        /// Green.
        g: f32,
        /// Blue.
        b: f32,
        /// Opacity.
        a: f32,
    }
    /// A truth value.
    #[derive(Copy)]
    Bool {
        /// The value.
        data: bool,
    }
    /// A text.
    String {
        /// The text.
        data: std::string::String,
    }
    /// A number.
    #[derive(Copy)]
    Float64 {
        /// The number.
        data: f64,
    }
}
