//! Pictures of the robot over one step, side by side under a caption.

use plotters::element::BitMapElement;
use plotters::prelude::*;

use crate::ReportError;
use crate::canvas::{FAINT, INK, Image, SCALE, draw, drawing, px, text};

/// One picture of the robot.
#[derive(Clone, Debug, PartialEq)]
pub struct Tile {
    /// When, s from the start of the step.
    pub time_s: f64,
    /// What the camera saw.
    pub image: Image,
}

/// Width of a tile in the strip, pixels.
const TILE_WIDTH: u32 = 360;
/// Between tiles.
const GAP: u32 = 8;
/// Tiles in one row.
const ROW: usize = 4;

/// Lays tiles into rows of four under a caption, each with its time.
///
/// # Errors
/// [`ReportError::BadImage`] if there is no tile or the tiles differ in size.
pub fn tile_strip(caption: &str, tiles: &[Tile]) -> Result<Image, ReportError> {
    let first = tiles.first().ok_or_else(|| ReportError::BadImage("no tiles; expected at least one".into()))?;
    let (width, height) = (first.image.width(), first.image.height());
    if let Some(other) = tiles.iter().find(|tile| (tile.image.width(), tile.image.height()) != (width, height)) {
        return Err(ReportError::BadImage(format!(
            "tiles of {width} x {height} and {} x {} pixels; expected one size",
            other.image.width(),
            other.image.height()
        )));
    }
    let tile_height = (f64::from(TILE_WIDTH) * f64::from(height) / f64::from(width)).round() as u32;
    let columns = tiles.len().min(ROW) as u32;
    let rows = tiles.len().div_ceil(ROW) as u32;
    let total_width = columns * TILE_WIDTH + (columns + 1) * GAP;
    let label = 30;
    let top = 56;
    let total_height = top + rows * (tile_height + label + GAP);
    draw(total_width, total_height, |area| {
        area.draw(&Text::new(caption.to_owned(), (px(GAP + 4) as i32, px(16) as i32), text(25, INK)))
            .map_err(drawing)?;
        for (index, tile) in tiles.iter().enumerate() {
            let (row, column) = ((index / ROW) as u32, (index % ROW) as u32);
            let x = px(GAP + column * (TILE_WIDTH + GAP));
            let y = px(top + row * (tile_height + label + GAP));
            let (wide, high) = (TILE_WIDTH * SCALE, tile_height * SCALE);
            let pixels = resized(&tile.image, wide, high);
            let element = BitMapElement::with_owned_buffer((x as i32, y as i32), (wide, high), pixels)
                .ok_or_else(|| ReportError::BadImage("a tile does not fit its frame".into()))?;
            area.draw(&element).map_err(drawing)?;
            let time = format!("t = {:.3} s", tile.time_s);
            let at = ((x + px(4)) as i32, (y + high + px(6)) as i32);
            area.draw(&Text::new(time, at, text(18, FAINT))).map_err(drawing)?;
        }
        Ok(())
    })
}

/// Bilinear.
fn resized(image: &Image, width: u32, height: u32) -> Vec<u8> {
    let (from_width, from_height) = (image.width() as usize, image.height() as usize);
    let rgb = image.rgb();
    let place = |index: u32, from: usize, to: u32| {
        let position = ((f64::from(index) + 0.5) * from as f64 / f64::from(to) - 0.5).clamp(0.0, (from - 1) as f64);
        let low = position as usize;
        (low, (low + 1).min(from - 1), position - low as f64)
    };
    let mut pixels = Vec::with_capacity((width * height * 3) as usize);
    for row in 0..height {
        let (above, below, down) = place(row, from_height, height);
        for column in 0..width {
            let (left, right, along) = place(column, from_width, width);
            for channel in 0..3 {
                let at = |y: usize, x: usize| f64::from(rgb[(y * from_width + x) * 3 + channel]);
                let upper = at(above, left) * (1.0 - along) + at(above, right) * along;
                let lower = at(below, left) * (1.0 - along) + at(below, right) * along;
                pixels.push((upper * (1.0 - down) + lower * down).round() as u8);
            }
        }
    }
    pixels
}
