//! A picture: drawn three times too large with built-in fonts, then averaged down, which smooths every edge alike.

use std::sync::Once;

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::FontStyle;

use crate::ReportError;

/// A picture, 8-bit red, green, blue, rows from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    width: u32,
    height: u32,
    rgb: Vec<u8>,
}

impl Image {
    /// `rgb` holds `width * height * 3` bytes, rows from the top.
    ///
    /// # Errors
    /// [`ReportError::BadImage`] if it holds another number, or the picture is empty.
    pub fn new(width: u32, height: u32, rgb: Vec<u8>) -> Result<Image, ReportError> {
        let expected = width as usize * height as usize * 3;
        if expected == 0 || rgb.len() != expected {
            return Err(ReportError::BadImage(format!(
                "{width} x {height} pixels in {} bytes; expected {expected}, more than 0",
                rgb.len()
            )));
        }
        Ok(Image { width, height, rgb })
    }

    /// Width, pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height, pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The pixels, rows from the top.
    pub fn rgb(&self) -> &[u8] {
        &self.rgb
    }

    /// The picture as a PNG file's bytes.
    ///
    /// # Errors
    /// [`ReportError::Drawing`] if the encoder refuses.
    pub fn to_png(&self) -> Result<Vec<u8>, ReportError> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width, self.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header().map_err(drawing)?;
        writer.write_image_data(&self.rgb).map_err(drawing)?;
        writer.finish().map_err(drawing)?;
        Ok(bytes)
    }
}

/// How much larger a picture is drawn than it is shown.
pub(crate) const SCALE: u32 = 3;

/// A length in shown pixels, as drawn.
pub(crate) const fn px(length: u32) -> u32 {
    length * SCALE
}

pub(crate) type Area<'a> = DrawingArea<BitMapBackend<'a>, Shift>;

/// The one type family of all pictures.
pub(crate) const FONT: &str = "tandem";

pub(crate) const INK: RGBColor = RGBColor(0x22, 0x26, 0x2b);
pub(crate) const FAINT: RGBColor = RGBColor(0x6b, 0x72, 0x7a);
pub(crate) const GRID: RGBColor = RGBColor(0xe6, 0xe8, 0xeb);
// Those of Okabe and Ito, which the colour-blind tell apart.
pub(crate) const VERMILION: RGBColor = RGBColor(0xd5, 0x5e, 0x00);
pub(crate) const GREEN: RGBColor = RGBColor(0x00, 0x9e, 0x73);
pub(crate) const BLUE: RGBColor = RGBColor(0x00, 0x72, 0xb2);
pub(crate) const ORANGE: RGBColor = RGBColor(0xe6, 0x9f, 0x00);

/// A text style, `size` in shown pixels.
pub(crate) fn text(size: u32, color: RGBColor) -> TextStyle<'static> {
    (FONT, px(size)).into_font().color(&color)
}

pub(crate) fn drawing(error: impl std::fmt::Display) -> ReportError {
    ReportError::Drawing(error.to_string())
}

/// Draws a picture of `width` x `height` shown pixels on white.
pub(crate) fn draw(
    width: u32,
    height: u32,
    paint: impl FnOnce(&Area) -> Result<(), ReportError>,
) -> Result<Image, ReportError> {
    register_font();
    let (large_width, large_height) = (px(width), px(height));
    let mut large = vec![255; (large_width * large_height * 3) as usize];
    {
        let area = BitMapBackend::with_buffer(&mut large, (large_width, large_height)).into_drawing_area();
        area.fill(&WHITE).map_err(drawing)?;
        paint(&area)?;
        area.present().map_err(drawing)?;
    }
    Image::new(width, height, reduce(&large, width, height))
}

fn register_font() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // Refusing it would mean that the font built into the program is none.
        plotters::style::register_font(FONT, FontStyle::Normal, epaint_default_fonts::UBUNTU_LIGHT)
            .unwrap_or_else(|_| panic!("the built-in font is not a font"));
    });
}

/// Averages squares of `SCALE` x `SCALE` pixels.
fn reduce(large: &[u8], width: u32, height: u32) -> Vec<u8> {
    let (width, height, scale) = (width as usize, height as usize, SCALE as usize);
    let mut rgb = vec![0; width * height * 3];
    for row in 0..height {
        for column in 0..width {
            for channel in 0..3 {
                let mut sum = 0_u32;
                for dy in 0..scale {
                    let start = ((row * scale + dy) * width * scale + column * scale) * 3 + channel;
                    for dx in 0..scale {
                        sum += u32::from(large[start + 3 * dx]);
                    }
                }
                rgb[(row * width + column) * 3 + channel] = (sum / (SCALE * SCALE)) as u8;
            }
        }
    }
    rgb
}
