//! Where a driven robot went: from above beside the way that was asked for, with footholds and pushes, and over time.

use std::f64::consts::FRAC_PI_6;
use std::ops::Range;

use plotters::prelude::*;

use crate::canvas::{Area, BLUE, FAINT, GRID, INK, Image, ORANGE, VERMILION, draw, drawing, px};
use crate::figures::{Chart, Labels, at_least, averaged, chart, heading, line, padded, panel_legend};
use crate::{ReportError, Run, Sample};

/// Size of the picture and of its view from above, shown pixels.
const SIZE: (u32, u32) = (1400, 1500);
const ABOVE: u32 = 800;
/// What a chart's labels take of its panel, shown pixels.
const BESIDE: (f64, f64) = (102.0, 78.0);
/// A push of this force is drawn a metre long, N.
const NEWTONS_A_METRE: f64 = 600.0;

/// What is known of a walk besides its samples.
#[derive(Clone, Copy, Debug, Default)]
pub struct Driven<'a> {
    /// Velocities that were asked for, each from its time on (s, on the samples' clock): ahead and to the left, m/s,
    /// turning, rad/s.
    pub asked: &'a [(f64, [f64; 3])],
    /// Pushes: when, s, and the force along the world's x and y, N.
    pub pushes: &'a [(f64, [f64; 2])],
    /// Where feet came down, in the world, m.
    pub footholds_m: &'a [[f64; 2]],
}

impl Driven<'_> {
    /// What is asked for at a time, if anything is.
    fn at(&self, time_s: f64) -> Option<[f64; 3]> {
        self.asked.iter().rev().find(|(from_s, _)| *from_s <= time_s).map(|(_, velocity)| *velocity)
    }

    /// The way that was asked for, walked exactly from where the robot was at the first command.
    fn way(&self, samples: &[Sample]) -> Vec<(f64, f64)> {
        let Some((from_s, _)) = self.asked.first() else { return Vec::new() };
        let begin = samples.partition_point(|sample| sample.time_s < *from_s);
        let Some(first) = samples.get(begin) else { return Vec::new() };
        let ([mut x, mut y, _], mut yaw) = (first.base_position_m, first.base_roll_pitch_yaw_rad[2]);
        let mut way = vec![(x, y)];
        for pair in samples[begin..].windows(2) {
            let dt_s = pair[1].time_s - pair[0].time_s;
            let [ahead, left, turning] = self.at(pair[0].time_s).unwrap_or_default();
            let (sine, cosine) = (yaw + 0.5 * turning * dt_s).sin_cos();
            (x, y) = (x + (cosine * ahead - sine * left) * dt_s, y + (sine * ahead + cosine * left) * dt_s);
            yaw += turning * dt_s;
            way.push((x, y));
        }
        way
    }
}

/// From above: the way asked for in vermilion, the way gone in the run's colour, footholds as dots, pushes as arrows.
/// Below: roll and pitch, speed ahead and turning, asked and got, over time.
///
/// # Errors
/// [`ReportError::TooLittle`], [`ReportError::BadSample`], [`ReportError::Drawing`].
pub fn driven(run: &Run, driven: &Driven) -> Result<Image, ReportError> {
    run.check()?;
    let samples = run.walking();
    draw(SIZE.0, SIZE.1, |area| {
        let gone_m: f64 = samples.windows(2).map(|pair| distance_m(&pair[0], &pair[1])).sum();
        let tilt = |sample: &Sample| sample.base_roll_pitch_yaw_rad[..2].iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        let tilt_deg = samples.iter().map(tilt).fold(0.0, f64::max).to_degrees();
        let note = format!("{gone_m:.1} m gone, tilted by {tilt_deg:.1} deg at most; arrows and dotted lines: pushes");
        let legend =
            [("way asked for", VERMILION), ("way gone", run.origin.colour()), ("footholds", FAINT), ("push", ORANGE)];
        let plot = heading(area, &format!("{}: driven, from above", run.gait.name), &note, &legend)?;
        let (above, below) = plot.split_vertically(px(ABOVE));
        from_above(&above, run, driven, samples)?;
        over_time(&below.split_evenly((3, 1)), run, driven, samples)
    })
}

fn distance_m(a: &Sample, b: &Sample) -> f64 {
    (b.base_position_m[0] - a.base_position_m[0]).hypot(b.base_position_m[1] - a.base_position_m[1])
}

fn from_above(panel: &Area, run: &Run, driven: &Driven, samples: &[Sample]) -> Result<(), ReportError> {
    let gone: Vec<_> = samples.iter().map(|sample| (sample.base_position_m[0], sample.base_position_m[1])).collect();
    let way = driven.way(samples);
    let feet = driven.footholds_m.iter().map(|[x, y]| (*x, *y));
    let all: Vec<_> = gone.iter().chain(&way).copied().chain(feet.clone()).collect();
    let (width, height) = (f64::from(SIZE.0) - BESIDE.0, f64::from(ABOVE) - BESIDE.1);
    let (x, y) = to_scale(padded(all.iter().map(|p| p.0)), padded(all.iter().map(|p| p.1)), width / height);
    let labels = Labels { x: "x (m)", y: "y (m)", wide: true, ..Labels::default() };
    let mut chart = chart(panel, x, y, labels)?;
    let dots = feet.map(|foot| Circle::new(foot, px(2), FAINT.mix(0.5).filled()));
    chart.draw_series(dots).map_err(drawing)?;
    line(&mut chart, &way, VERMILION.to_rgba(), 2.0)?;
    line(&mut chart, &gone, run.origin.colour().to_rgba(), 2.4)?;
    for (time_s, force_n) in driven.pushes {
        let place = samples.partition_point(|sample| sample.time_s < *time_s).min(samples.len() - 1);
        arrow(&mut chart, gone[place], force_n.map(|newtons| newtons / NEWTONS_A_METRE))?;
    }
    Ok(())
}

/// Both ranges, one of them widened, so that a metre is as long along both axes of a picture `aspect` times as wide as
/// high.
fn to_scale(x: Range<f64>, y: Range<f64>, aspect: f64) -> (Range<f64>, Range<f64>) {
    let height = (y.end - y.start).max((x.end - x.start) / aspect);
    (at_least(x, height * aspect), at_least(y, height))
}

/// Its point at the robot.
fn arrow(chart: &mut Chart, (x, y): (f64, f64), [along, across]: [f64; 2]) -> Result<(), ReportError> {
    line(chart, &[(x - along, y - across), (x, y)], ORANGE.to_rgba(), 4.0)?;
    let (direction, head) = (across.atan2(along), 0.3 * along.hypot(across));
    for side in [-FRAC_PI_6, FRAC_PI_6] {
        let (sine, cosine) = (direction + side).sin_cos();
        line(chart, &[(x - head * cosine, y - head * sine), (x, y)], ORANGE.to_rgba(), 4.0)?;
    }
    Ok(())
}

fn over_time(panels: &[Area], run: &Run, driven: &Driven, samples: &[Sample]) -> Result<(), ReportError> {
    let time = samples[0].time_s..samples[samples.len() - 1].time_s;
    let course = |value: &dyn Fn(&Sample) -> f64| -> Vec<(f64, f64)> {
        samples.iter().map(|sample| (sample.time_s, value(sample))).collect()
    };
    let smooth = |points: Vec<(f64, f64)>| averaged(&points, run.gait.stride_duration_s());
    let ahead = course(&|sample| {
        let (sine, cosine) = sample.base_roll_pitch_yaw_rad[2].sin_cos();
        cosine * sample.base_linear_velocity_m_s[0] + sine * sample.base_linear_velocity_m_s[1]
    });
    let asked = |axis: usize| -> Vec<(f64, f64)> {
        samples.iter().filter_map(|s| driven.at(s.time_s).map(|velocity| (s.time_s, velocity[axis]))).collect()
    };
    let angle = |axis: usize| course(&|sample| sample.base_roll_pitch_yaw_rad[axis].to_degrees());
    let own = run.origin.colour();
    let rows = [
        ("angle (deg)", 4.0, [("roll", angle(0), BLUE), ("pitch", angle(1), INK)]),
        ("ahead (m/s)", 0.2, [("stride's mean", smooth(ahead), own), ("asked for", asked(0), VERMILION)]),
        (
            "turning (rad/s)",
            0.2,
            [("stride's mean", smooth(turning(samples)), own), ("asked for", asked(2), VERMILION)],
        ),
    ];
    for (row, (label, least, series)) in rows.iter().enumerate() {
        let x = if row == 2 { "time (s)" } else { "" };
        let values = at_least(padded(series.iter().flat_map(|(_, points, _)| points).map(|point| point.1)), *least);
        let labels = Labels { x, y: label, wide: true, ..Labels::default() };
        let mut chart = chart(&panels[row], time.clone(), values.clone(), labels)?;
        line(&mut chart, &[(time.start, 0.0), (time.end, 0.0)], GRID.to_rgba(), 1.0)?;
        for (at_s, _) in driven.pushes {
            let dots = [(*at_s, values.start), (*at_s, values.end)];
            let dotted = DashedLineSeries::new(dots, px(3), px(4), ORANGE.stroke_width(px(2)));
            chart.draw_series(dotted).map_err(drawing)?;
        }
        for (_, points, colour) in series {
            let every = points.len().div_ceil(5000).max(1);
            line(&mut chart, &points.iter().step_by(every).copied().collect::<Vec<_>>(), colour.to_rgba(), 1.6)?;
        }
        let shown = series.iter().filter(|(_, points, _)| !points.is_empty());
        panel_legend(&panels[row], &shown.map(|(name, _, colour)| (*name, *colour)).collect::<Vec<_>>())?;
    }
    Ok(())
}

/// Rate of the heading, rad/s.
fn turning(samples: &[Sample]) -> Vec<(f64, f64)> {
    let rate = |pair: &[Sample]| {
        let turned = pair[1].base_roll_pitch_yaw_rad[2] - pair[0].base_roll_pitch_yaw_rad[2];
        let whole = (turned / std::f64::consts::TAU).round() * std::f64::consts::TAU;
        (pair[1].time_s, (turned - whole) / (pair[1].time_s - pair[0].time_s))
    };
    samples.windows(2).map(rate).collect()
}
