//! Pictures of a walk that is over: tiles of a stride and its animation, drawn from samples, wherever they come from.

use crate::{Camera, Image, PictureError, Renderer, RobotState, Simulator, SimulatorError, SimulatorOptions};
use gait::Gait;
use report::{Sample, Tile};
use robot::Robot;

/// Size of a tile, pixels.
const TILE: (usize, usize) = (1080, 810);
/// Tiles of a stride.
const TILES: usize = 8;
/// Size of the animation, pixels.
const ANIMATION: (usize, usize) = (560, 380);
/// Frames of the animation per second of its own time; it runs at half speed.
const FRAMES_PER_S: f64 = 25.0;
/// How much slower than life the animation runs.
const SLOWNESS: f64 = 2.0;
/// Strides before this are not shown: the robot settles, s.
const SETTLING_S: f64 = 2.0;

/// Why there are no pictures of a walk.
#[derive(Debug, thiserror::Error)]
pub enum FilmError {
    /// The robot's model.
    #[error(transparent)]
    Simulator(#[from] SimulatorError),
    /// Drawing.
    #[error(transparent)]
    Picture(#[from] PictureError),
    /// A picture of the wrong size.
    #[error(transparent)]
    Report(#[from] report::ReportError),
    /// The walk is shorter than a stride.
    #[error("no pictures: the walk ends {0:.2} s after its first step, before its second stride is over")]
    TooShort(f64),
}

/// The state as the report takes it.
pub fn sample(state: &RobotState) -> Sample {
    Sample {
        time_s: state.time_s,
        base_position_m: state.base_position_m,
        base_roll_pitch_yaw_rad: state.roll_pitch_yaw(),
        base_linear_velocity_m_s: state.base_linear_velocity_world,
        joint_position_rad: state.joint_position_rad,
        joint_velocity_rad_s: state.joint_velocity_rad_s,
        joint_torque_nm: state.joint_torque_nm,
        ground_force_n: state.toe_force_n.map(|force| force[2]),
    }
}

/// A place where the robot is posed and pictured.
pub struct Studio<'a> {
    simulator: Simulator,
    gait: &'a Gait,
    samples: &'a [Sample],
    /// Start of the stride that is shown, s.
    start_s: f64,
}

impl<'a> Studio<'a> {
    /// Prepares pictures of one stride of a walk that began at `walking_from_s`, on the ground of `options`.
    ///
    /// # Errors
    /// A walk of less than two strides, or a robot that the simulator cannot load.
    pub fn new(
        robot: &Robot,
        options: &SimulatorOptions,
        gait: &'a Gait,
        samples: &'a [Sample],
        walking_from_s: f64,
    ) -> Result<Self, FilmError> {
        let options = SimulatorOptions { fine_pictures: true, ..options.clone() };
        let stride_s = gait.stride_duration_s();
        let walked_s = samples.last().map_or(0.0, |last| last.time_s - walking_from_s);
        // The last stride that is whole, or the first after settling, whichever is earlier; never the very first.
        let last = (walked_s / stride_s).floor() - 1.0;
        let stride = (SETTLING_S / stride_s).ceil().min(last);
        if stride < 1.0 {
            return Err(FilmError::TooShort(walked_s));
        }
        Ok(Self {
            simulator: Simulator::new(robot, options)?,
            gait,
            samples,
            start_s: walking_from_s + stride * stride_s,
        })
    }

    fn draw(&mut self, renderer: &mut Renderer, since_start_s: f64, camera: Camera) -> Result<Image, PictureError> {
        let time_s = self.start_s + since_start_s;
        let after = self.samples.partition_point(|sample| sample.time_s < time_s).min(self.samples.len() - 1);
        let sample = &self.samples[after];
        self.simulator.pose(sample.base_position_m, sample.base_roll_pitch_yaw_rad, &sample.joint_position_rad);
        renderer.draw(&mut self.simulator, camera)
    }

    /// Eight pictures over the stride, from the side.
    ///
    /// # Errors
    /// [`PictureError`] in [`FilmError::Picture`]: where OpenGL is missing it says what to install.
    pub fn tiles(&mut self) -> Result<Vec<Tile>, FilmError> {
        let mut renderer = Renderer::new(&self.simulator, TILE.0, TILE.1)?;
        let stride_s = self.gait.stride_duration_s();
        (0..TILES)
            .map(|i| {
                let time_s = stride_s * i as f64 / (TILES - 1) as f64;
                let image = self.draw(&mut renderer, time_s, Camera::Side)?;
                let image = report::Image::new(image.width as u32, image.height as u32, image.rgb)?;
                Ok(Tile { time_s, image })
            })
            .collect()
    }

    /// The stride as an animated PNG that repeats, at half speed.
    ///
    /// # Errors
    /// As [`Studio::tiles`].
    pub fn animation(&mut self) -> Result<Vec<u8>, FilmError> {
        let mut renderer = Renderer::new(&self.simulator, ANIMATION.0, ANIMATION.1)?;
        let stride_s = self.gait.stride_duration_s();
        let frames = (SLOWNESS * stride_s * FRAMES_PER_S).round().max(2.0) as usize;
        let images = (0..frames)
            .map(|i| self.draw(&mut renderer, stride_s * i as f64 / frames as f64, Camera::ThreeQuarter))
            .collect::<Result<Vec<_>, _>>()?;
        Ok(Image::animated_png(&images, SLOWNESS * stride_s / frames as f64)?)
    }
}
