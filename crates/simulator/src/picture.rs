//! Pictures of the robot: MuJoCo's renderer without a display (EGL, in software where there is no graphics card).

use crate::{Simulator, description};
use mujoco_rs::prelude::MjtObjBase;
use mujoco_rs::prelude::{MjvCamera, MjvOption};
use mujoco_rs::renderer::MjRenderer;
use std::path::{Path, PathBuf};

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// OpenGL without a display could not be opened.
    #[error(
        "no pictures: OpenGL without a display is not available ({0}). Install it: apt-get install libegl1 libgl1-mesa-dri"
    )]
    NoDisplay(String),
    /// The size is zero or above 1920 by 1200 pixels.
    #[error("a picture of {width} by {height} pixels is asked for; expected 1 to 1920 by 1 to 1200")]
    Size {
        /// Width, pixels.
        width: usize,
        /// Height, pixels.
        height: usize,
    },
    /// MuJoCo could not draw.
    #[error("drawing failed: {0}")]
    Draw(String),
    /// The file could not be written.
    #[error("{}: {problem}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        problem: String,
    },
}

/// Where the robot is seen from. Every camera follows the base.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Camera {
    /// From the robot's right, a little above the ground: feet and knees in profile.
    Side,
    /// From the front right and above.
    ThreeQuarter,
}

/// An image of 8-bit red, green and blue, row by row from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Width, pixels.
    pub width: usize,
    /// Height, pixels.
    pub height: usize,
    /// 3 × width × height bytes.
    pub rgb: Vec<u8>,
}

impl Image {
    /// Places images of one height beside each other, `gap` white pixels apart.
    pub fn side_by_side(images: &[Image], gap: usize) -> Image {
        let height = images.iter().map(|i| i.height).max().unwrap_or(0);
        let width = images.iter().map(|i| i.width).sum::<usize>() + gap * images.len().saturating_sub(1);
        let mut joined = Image { width, height, rgb: vec![255; 3 * width * height] };
        let mut left = 0;
        for image in images {
            for row in 0..image.height {
                let from = 3 * row * image.width;
                let to = 3 * (row * width + left);
                joined.rgb[to..to + 3 * image.width].copy_from_slice(&image.rgb[from..from + 3 * image.width]);
            }
            left += image.width + gap;
        }
        joined
    }

    /// The image as a PNG file's bytes.
    pub fn to_png(&self) -> Result<Vec<u8>, PictureError> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::High);
        encoder
            .write_header()
            .and_then(|mut writer| writer.write_image_data(&self.rgb))
            .map_err(|e| PictureError::Draw(e.to_string()))?;
        Ok(bytes)
    }

    /// Images of one size as an animated PNG's bytes, `frame_s` seconds each, repeating for ever. Programs that know no
    /// animation show the first.
    pub fn animated_png(images: &[Image], frame_s: f64) -> Result<Vec<u8>, PictureError> {
        let draw = |e: png::EncodingError| PictureError::Draw(e.to_string());
        let first = images.first().ok_or_else(|| PictureError::Draw("an animation needs at least one frame".into()))?;
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, first.width as u32, first.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::High);
        encoder.set_animated(images.len() as u32, 0).map_err(draw)?;
        encoder.set_frame_delay((1e3 * frame_s).round().clamp(1.0, 6e4) as u16, 1000).map_err(draw)?;
        let mut writer = encoder.write_header().map_err(draw)?;
        for image in images {
            writer.write_image_data(&image.rgb).map_err(draw)?;
        }
        writer.finish().map_err(draw)?;
        Ok(bytes)
    }

    /// Writes the image as a PNG file.
    pub fn write_png(&self, path: &Path) -> Result<(), PictureError> {
        std::fs::write(path, self.to_png()?)
            .map_err(|e| PictureError::Write { path: path.into(), problem: e.to_string() })
    }
}

/// Draws a [`Simulator`]. It stays on the thread that made it.
pub struct Renderer {
    renderer: MjRenderer,
    width: usize,
    height: usize,
}

impl std::fmt::Debug for Renderer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Renderer({} x {})", self.width, self.height)
    }
}

impl Renderer {
    /// Opens OpenGL for pictures of `width` by `height` pixels of robots like the simulator's.
    pub fn new(simulator: &Simulator, width: usize, height: usize) -> Result<Self, PictureError> {
        if !(1..=1920).contains(&width) || !(1..=1200).contains(&height) {
            return Err(PictureError::Size { width, height });
        }
        let renderer = MjRenderer::builder()
            .width(width as u32)
            .height(height as u32)
            .opts(MjvOption::default())
            .build(simulator.data.model())
            .map_err(|e| {
                let cause = std::error::Error::source(&e).map_or_else(|| e.to_string(), |cause| cause.to_string());
                PictureError::NoDisplay(cause)
            })?;
        Ok(Self { renderer, width, height })
    }

    /// Draws the robot as it is now.
    pub fn draw(&mut self, simulator: &mut Simulator, camera: Camera) -> Result<Image, PictureError> {
        let base = simulator
            .data
            .model()
            .name_to_id(MjtObjBase::mjOBJ_BODY, description::BASE)
            .ok_or_else(|| PictureError::Draw("the model has no base".into()))?;
        let ground = simulator.options().terrain.ground_m(simulator.data.qpos()[0], simulator.data.qpos()[1]);
        let [x, y, _] = simulator.data.xpos()[base];
        let mut view = MjvCamera::default();
        view.free();
        // The camera follows the base over the ground but not up and down, so that the bobbing of the body is seen.
        let (azimuth, elevation, distance, look_up) = match camera {
            Camera::Side => (90.0, -6.0, 2.05, 0.33),
            Camera::ThreeQuarter => (138.0, -14.0, 2.25, 0.31),
        };
        view.lookat = [x, y, ground + look_up];
        view.azimuth = azimuth;
        view.elevation = elevation;
        view.distance = distance;
        self.renderer.set_camera(view);
        let draw = |e: mujoco_rs::prelude::RendererError| PictureError::Draw(e.to_string());
        self.renderer.sync_data(simulator.data_mut()).map_err(draw)?;
        self.renderer.render().map_err(draw)?;
        let rgb = self.renderer.rgb_flat().ok_or_else(|| PictureError::Draw("no image came back".into()))?;
        Ok(Image { width: self.width, height: self.height, rgb: rgb.to_vec() })
    }
}
