//! The figures of a run.

use std::ops::Range;

use gait::{JOINTS_PER_LEG, LEG_LABELS, LEGS};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::canvas::{Area, BLUE, FAINT, GREEN, GRID, INK, Image, ORANGE, VERMILION, draw, drawing, px, text};
use crate::planned_stride::{planned_orbit, planned_steps};
use crate::run::{Run, STANDING_N, Sample};
use crate::{Origin, ReportError, mean_absolute_torque_nm, mean_forward_speed_m_s, table_two};

pub(crate) const JOINT_TYPES: [&str; JOINTS_PER_LEG] = ["hip roll", "hip pitch", "knee"];
pub(crate) const JOINT_COLOURS: [RGBColor; JOINTS_PER_LEG] = [BLUE, ORANGE, GREEN];

pub(crate) type Chart<'a, 'b> = ChartContext<'a, BitMapBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

impl Origin {
    pub(crate) fn word(self) -> &'static str {
        match self {
            Origin::Simulated => "simulated",
            Origin::Recorded => "recorded",
        }
    }

    pub(crate) fn colour(self) -> RGBColor {
        match self {
            Origin::Simulated => GREEN,
            Origin::Recorded => BLUE,
        }
    }
}

/// Joint velocity over joint position in settled walking, one panel a joint type: the planned orbits in vermilion, the run's in its own
/// colour (the paper's tracking figure). A right leg is shown through the gait's mirror, so that all four legs share the orbits of
/// a front and a rear leg.
///
/// # Errors
/// [`ReportError::TooLittle`], [`ReportError::BadSample`], [`ReportError::Drawing`].
pub fn phase_portraits(run: &Run) -> Result<Image, ReportError> {
    run.check()?;
    let settled = run.settled();
    let gait = run.gait;
    let seconds = span_s(settled);
    draw(1500, 590, |area| {
        let word = run.origin.word();
        let title = format!("{}: planned and {word} joints, {seconds:.0} s of walking", gait.name);
        let plot = heading(
            area,
            &title,
            "all four legs; the right ones mirrored onto the left",
            &[("planned", VERMILION), (word, run.origin.colour())],
        )?;
        for (joint, panel) in plot.split_evenly((1, JOINTS_PER_LEG)).iter().enumerate() {
            let walked: Vec<Vec<(f64, f64)>> = (0..LEGS)
                .map(|leg| {
                    let sign = if leg < LEGS / 2 { 1.0 } else { gait.mirror.sign[joint] };
                    let index = leg * JOINTS_PER_LEG + joint;
                    let point = |sample: &Sample| {
                        (sign * sample.joint_position_rad[index], sign * sample.joint_velocity_rad_s[index])
                    };
                    settled.iter().map(point).collect()
                })
                .collect();
            let planned: Vec<Vec<(f64, f64)>> =
                (0..LEGS / 2).map(|leg| planned_orbit(run.gait, leg * JOINTS_PER_LEG + joint, 200)).collect();
            let all = || walked.iter().chain(&planned).flatten();
            let mut chart = chart(
                panel,
                at_least(padded(all().map(|point| point.0)), 0.1),
                at_least(padded(all().map(|point| point.1)), 1.0),
                Labels { title: JOINT_TYPES[joint], x: "position (rad)", y: "velocity (rad/s)", ..Labels::default() },
            )?;
            for orbit in &walked {
                line(&mut chart, orbit, run.origin.colour().mix(0.45), 1.0)?;
            }
            for orbit in &planned {
                line(&mut chart, orbit, VERMILION.to_rgba(), 2.2)?;
            }
        }
        Ok(())
    })
}

/// Mean absolute torque by joint type in settled walking, beside the paper's Table II if it has this behaviour.
///
/// # Errors
/// [`ReportError::TooLittle`], [`ReportError::BadSample`], [`ReportError::Drawing`].
pub fn torque_bars(run: &Run) -> Result<Image, ReportError> {
    run.check()?;
    let settled = run.settled();
    let mut groups =
        vec![(format!("{}, this run", run.origin.word()), run.origin.colour(), mean_absolute_torque_nm(settled))];
    if let Some(paper) = table_two(&run.gait.robot, &run.gait.name) {
        groups.push(("Ma & Ames 2020, MuJoCo".into(), RGBColor(0x8a, 0x93, 0x9d), paper.mujoco_nm));
        groups.push(("Ma & Ames 2020, experiment".into(), RGBColor(0xc9, 0xce, 0xd4), paper.experiment_nm));
    }
    draw(900, 560, |area| {
        let title = format!("{}: mean absolute torque", run.gait.name);
        let legend: Vec<(&str, RGBColor)> = groups.iter().map(|(name, colour, _)| (name.as_str(), *colour)).collect();
        let note = format!("over all four legs, {:.0} s of walking", span_s(settled));
        let plot = heading(area, &title, &note, &legend)?;
        let highest = groups.iter().flat_map(|(_, _, values)| values).fold(0.0_f64, |a, b| a.max(*b));
        let joint_name = |x: &f64| -> String {
            let index = x.round();
            if (x - index).abs() < 1e-6 && (0.0..3.0).contains(&index) {
                JOINT_TYPES[index as usize].into()
            } else {
                String::new()
            }
        };
        let mut chart = ChartBuilder::on(&plot)
            .margin(px(10))
            .x_label_area_size(px(34))
            .y_label_area_size(px(70))
            .build_cartesian_2d(-0.5..2.5, 0.0..highest * 1.12 + 0.1)
            .map_err(drawing)?;
        chart
            .configure_mesh()
            .disable_x_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(GRID.stroke_width(px(1)))
            .axis_style(INK.stroke_width(px(1)))
            .set_all_tick_mark_size(px(5))
            .y_label_formatter(&marks(&(0.0..highest), 10))
            .x_labels(7)
            .x_label_formatter(&joint_name)
            .x_label_style(text(19, INK))
            .y_label_style(text(16, INK))
            .y_desc("mean absolute torque (N m)")
            .axis_desc_style(text(18, INK))
            .draw()
            .map_err(drawing)?;
        let width = 0.8 / groups.len().max(2) as f64;
        for (number, (_, colour, values)) in groups.iter().enumerate() {
            for (joint, value) in values.iter().enumerate() {
                let left = joint as f64 + (number as f64 - groups.len() as f64 / 2.0) * width;
                let right = left + width * 0.92;
                chart
                    .draw_series([Rectangle::new([(left, 0.0), (right, *value)], colour.filled())])
                    .map_err(drawing)?;
                let style = text(17, INK).pos(Pos::new(HPos::Center, VPos::Bottom));
                let at = ((left + right) / 2.0, value + highest * 0.01);
                chart.draw_series([Text::new(format!("{value:.2}"), at, style)]).map_err(drawing)?;
            }
        }
        Ok(())
    })
}

/// Mean absolute torque by joint type, body height, roll and pitch, forward speed, over the whole run. Torque and speed are
/// averaged over one stride; the speed's own course is drawn faintly behind.
///
/// # Errors
/// [`ReportError::TooLittle`], [`ReportError::BadSample`], [`ReportError::Drawing`].
pub fn time_series(run: &Run) -> Result<Image, ReportError> {
    run.check()?;
    let samples = run.samples;
    let stride_s = run.gait.stride_duration_s();
    let time = samples[0].time_s..samples[samples.len() - 1].time_s;
    let course = |value: &dyn Fn(&Sample) -> f64| -> Vec<(f64, f64)> {
        samples.iter().map(|sample| (sample.time_s, value(sample))).collect()
    };
    let torque: Vec<Vec<(f64, f64)>> = (0..JOINTS_PER_LEG)
        .map(|joint| {
            let mean = |sample: &Sample| {
                (0..LEGS).map(|leg| sample.joint_torque_nm[leg * JOINTS_PER_LEG + joint].abs()).sum::<f64>()
                    / LEGS as f64
            };
            averaged(&course(&mean), stride_s)
        })
        .collect();
    let height = course(&|sample| sample.base_position_m[2]);
    let roll = course(&|sample| sample.base_roll_pitch_yaw_rad[0].to_degrees());
    let pitch = course(&|sample| sample.base_roll_pitch_yaw_rad[1].to_degrees());
    let speed = course(&|sample| {
        let (sin, cos) = sample.base_roll_pitch_yaw_rad[2].sin_cos();
        cos * sample.base_linear_velocity_m_s[0] + sin * sample.base_linear_velocity_m_s[1]
    });
    let mean_speed = averaged(&speed, stride_s);
    let asked = run.gait.speed_m_s();
    draw(1400, 1180, |area| {
        let title = format!("{}: {} run", run.gait.name, run.origin.word());
        let got = mean_forward_speed_m_s(run.settled());
        let note =
            format!("the gait's speed {asked:.2} m/s, along the first heading {got:.2} m/s; dotted: walking begins");
        let plot = heading(area, &title, &note, &[])?;
        let panels = plot.split_evenly((4, 1));
        let panel = |index: usize, label: &str, values: Range<f64>, series: &[Series]| -> Result<(), ReportError> {
            let last = index == 3;
            let labels = Labels { x: if last { "time (s)" } else { "" }, y: label, wide: true, ..Labels::default() };
            let mut chart = chart(&panels[index], time.clone(), values.clone(), labels)?;
            let start = run.walking_from_s;
            if start > time.start {
                let dots = DashedLineSeries::new(
                    [(start, values.start), (start, values.end)],
                    px(3),
                    px(4),
                    FAINT.stroke_width(px(1)),
                );
                chart.draw_series(dots).map_err(drawing)?;
            }
            for one in series {
                line(&mut chart, &thinned(one.points), one.colour, one.width)?;
            }
            let named: Vec<(&str, RGBColor)> =
                series.iter().filter(|one| !one.name.is_empty()).map(|one| (one.name, solid(one.colour))).collect();
            panel_legend(&panels[index], &named)
        };
        let joints: Vec<Series> = (0..JOINTS_PER_LEG)
            .map(|joint| Series::new(JOINT_TYPES[joint], &torque[joint], JOINT_COLOURS[joint].to_rgba(), 1.8))
            .collect();
        let highest = torque.iter().flatten().fold(0.0_f64, |a, point| a.max(point.1));
        panel(0, "mean |torque| (N m)", 0.0..highest * 1.25 + 0.1, &joints)?;
        panel(
            1,
            "body height (m)",
            at_least(padded(height.iter().map(|p| p.1)), 0.04),
            &[Series::new("", &height, INK.to_rgba(), 1.4)],
        )?;
        let angles = at_least(padded(roll.iter().chain(&pitch).map(|p| p.1)), 4.0);
        panel(
            2,
            "angle (deg)",
            angles,
            &[Series::new("roll", &roll, BLUE.to_rgba(), 1.4), Series::new("pitch", &pitch, ORANGE.to_rgba(), 1.4)],
        )?;
        let line_of_plan = vec![(run.walking_from_s.max(time.start), asked), (time.end, asked)];
        let speeds = at_least(padded(speed.iter().chain(&line_of_plan).map(|p| p.1)), 0.2);
        panel(
            3,
            "forward speed (m/s)",
            speeds,
            &[
                Series::new("", &speed, run.origin.colour().mix(0.35), 1.0),
                Series::new("the gait's", &line_of_plan, VERMILION.to_rgba(), 1.8),
                Series::new("stride's mean", &mean_speed, run.origin.colour().to_rgba(), 2.2),
            ],
        )
    })
}

/// Which foot stands when, over the last strides, with the plan under each row.
///
/// # Errors
/// [`ReportError::TooLittle`], [`ReportError::BadSample`], [`ReportError::Drawing`].
pub fn footfalls(run: &Run) -> Result<Image, ReportError> {
    run.check()?;
    let walking = run.walking();
    let last_s = walking[walking.len() - 1].time_s;
    // Whole steps, so that the picture begins with a switch.
    let steps = planned_steps(run.gait, last_s - run.walking_from_s);
    let shown = &steps[steps.len().saturating_sub(8)..];
    let (Some(first), Some(last)) = (shown.first(), shown.last()) else {
        let problem = "not one whole step of walking".into();
        return Err(ReportError::TooLittle { run: run.gait.name.clone(), problem });
    };
    let [start_s, end_s] = [first.from_s, last.to_s].map(|time_s| run.walking_from_s + time_s);
    let window = &walking[walking.partition_point(|sample| sample.time_s < start_s)..];
    let window = &window[..window.partition_point(|sample| sample.time_s <= end_s)];
    let colour = run.origin.colour();
    draw(1400, 470, |area| {
        let title = format!("{}: footfalls of the last {} steps", run.gait.name, shown.len());
        let note =
            format!("a foot stands where it carries more than {STANDING_N:.0} N; vertical lines: switch of steps");
        let plot = heading(
            area,
            &title,
            &note,
            &[("planned stance", VERMILION), (&format!("{} stance", run.origin.word()), colour)],
        )?;
        let leg_name = |y: &f64| -> String {
            let row = y.round();
            if (y - row).abs() < 1e-6 && (0.0..4.0).contains(&row) {
                LEG_LABELS[3 - row as usize].into()
            } else {
                String::new()
            }
        };
        let mut chart = ChartBuilder::on(&plot)
            .margin(px(10))
            .x_label_area_size(px(52))
            .y_label_area_size(px(120))
            .build_cartesian_2d(start_s..end_s, -0.6..3.6)
            .map_err(drawing)?;
        chart
            .configure_mesh()
            .disable_mesh()
            .axis_style(INK.stroke_width(px(1)))
            .set_tick_mark_size(LabelAreaPosition::Left, 0)
            .set_tick_mark_size(LabelAreaPosition::Bottom, px(5))
            .y_labels(9)
            .y_label_formatter(&leg_name)
            .x_label_formatter(&marks(&(start_s..end_s), 11))
            .x_label_style(text(16, INK))
            .y_label_style(text(18, INK))
            .x_desc("time (s)")
            .axis_desc_style(text(18, INK))
            .draw()
            .map_err(drawing)?;
        for at in shown.iter().map(|step| run.walking_from_s + step.from_s).chain([end_s]) {
            line(&mut chart, &[(at, -0.6), (at, 3.6)], GRID.to_rgba(), 1.0)?;
        }
        for leg in 0..LEGS {
            let row = (LEGS - 1 - leg) as f64;
            for (from, to) in stretches(window, |sample| sample.ground_force_n[leg] > STANDING_N) {
                chart
                    .draw_series([Rectangle::new([(from, row - 0.12), (to, row + 0.32)], colour.filled())])
                    .map_err(drawing)?;
            }
            for step in shown.iter().filter(|step| step.stands[leg]) {
                let [from, to] = [step.from_s, step.to_s].map(|time_s| run.walking_from_s + time_s);
                let stance = [(from, row - 0.32), (to, row - 0.2)];
                chart.draw_series([Rectangle::new(stance, VERMILION.filled())]).map_err(drawing)?;
            }
        }
        Ok(())
    })
}

/// Stretches of time in which something holds.
pub(crate) fn stretches(samples: &[Sample], holds: impl Fn(&Sample) -> bool) -> Vec<(f64, f64)> {
    let mut found = Vec::new();
    let mut since = None;
    for sample in samples {
        match (since, holds(sample)) {
            (None, true) => since = Some(sample.time_s),
            (Some(from), false) => {
                found.push((from, sample.time_s));
                since = None;
            }
            _ => {}
        }
    }
    if let (Some(from), Some(last)) = (since, samples.last()) {
        found.push((from, last.time_s));
    }
    found
}

struct Series<'a> {
    name: &'a str,
    points: &'a [(f64, f64)],
    colour: RGBAColor,
    width: f64,
}

impl<'a> Series<'a> {
    fn new(name: &'a str, points: &'a [(f64, f64)], colour: RGBAColor, width: f64) -> Series<'a> {
        Series { name, points, colour, width }
    }
}

fn solid(colour: RGBAColor) -> RGBColor {
    RGBColor(colour.0, colour.1, colour.2)
}

fn span_s(samples: &[Sample]) -> f64 {
    match samples {
        [first, .., last] => last.time_s - first.time_s,
        _ => 0.0,
    }
}

/// Mean over the window of that length that ends at each point (shorter at the start).
pub(crate) fn averaged(points: &[(f64, f64)], window_s: f64) -> Vec<(f64, f64)> {
    let mut sum = 0.0;
    let mut oldest = 0;
    let mut means = Vec::with_capacity(points.len());
    for (index, (time, value)) in points.iter().enumerate() {
        sum += value;
        while points[oldest].0 <= time - window_s {
            sum -= points[oldest].1;
            oldest += 1;
        }
        means.push((*time, sum / (index - oldest + 1) as f64));
    }
    means
}

/// About as many points as can be distinguished in a wide picture.
fn thinned(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let every = points.len().div_ceil(5000).max(1);
    points.iter().step_by(every).copied().collect()
}

pub(crate) fn padded(values: impl Iterator<Item = f64>) -> Range<f64> {
    let (low, high) =
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
    let margin = ((high - low) * 0.07).max(1e-6);
    low - margin..high + margin
}

/// The range, widened about its middle to a least width: noise then looks like noise.
pub(crate) fn at_least(range: Range<f64>, width: f64) -> Range<f64> {
    let middle = (range.start + range.end) / 2.0;
    let half = ((range.end - range.start) / 2.0).max(width / 2.0);
    middle - half..middle + half
}

/// Writes the numbers along an axis that has at most `count` of them, all with the same decimals.
fn marks(range: &Range<f64>, count: usize) -> impl Fn(&f64) -> String + use<> {
    let finest = (range.end - range.start) / count as f64;
    let decimals = (-finest.log10()).ceil().clamp(0.0, 6.0) as usize;
    move |value| {
        let text = format!("{value:.decimals$}");
        if text.trim_matches(['-', '0', '.']).is_empty() { text.trim_start_matches('-').to_owned() } else { text }
    }
}

#[derive(Default)]
pub(crate) struct Labels<'a> {
    pub title: &'a str,
    pub x: &'a str,
    pub y: &'a str,
    /// More marks on the time axis.
    pub wide: bool,
}

pub(crate) fn chart<'a, 'b>(
    panel: &'a Area<'b>,
    x: Range<f64>,
    y: Range<f64>,
    labels: Labels,
) -> Result<Chart<'a, 'b>, ReportError> {
    let mut builder = ChartBuilder::on(panel);
    builder.margin(px(10)).margin_right(px(18)).y_label_area_size(px(74));
    builder.x_label_area_size(px(if labels.x.is_empty() { 30 } else { 58 }));
    if !labels.title.is_empty() {
        builder.caption(labels.title, text(22, INK));
    }
    let (x_marks, y_marks) = if labels.wide { (12, 5) } else { (6, 8) };
    let (x_word, y_word) = (marks(&x, x_marks), marks(&y, y_marks));
    let mut chart = builder.build_cartesian_2d(x, y).map_err(drawing)?;
    let mut mesh = chart.configure_mesh();
    mesh.set_all_tick_mark_size(px(5))
        .x_label_formatter(&x_word)
        .y_label_formatter(&y_word)
        .light_line_style(TRANSPARENT)
        .bold_line_style(GRID.stroke_width(px(1)))
        .axis_style(INK.stroke_width(px(1)))
        .label_style(text(16, INK))
        .axis_desc_style(text(18, INK))
        .x_labels(x_marks)
        .y_labels(y_marks)
        .x_desc(labels.x)
        .y_desc(labels.y);
    mesh.draw().map_err(drawing)?;
    Ok(chart)
}

/// By segments: joined at a touchdown's sharp turn, a wide line grows a spike far out of the plot.
pub(crate) fn line(chart: &mut Chart, points: &[(f64, f64)], colour: RGBAColor, width: f64) -> Result<(), ReportError> {
    let style = colour.stroke_width((width * f64::from(px(1))).round() as u32);
    chart.draw_series(points.windows(2).map(|ends| PathElement::new(ends.to_vec(), style))).map(|_| ()).map_err(drawing)
}

/// Title, note and legend on top of a picture; gives the area below them.
pub(crate) fn heading<'b>(
    area: &Area<'b>,
    title: &str,
    note: &str,
    legend: &[(&str, RGBColor)],
) -> Result<Area<'b>, ReportError> {
    let (top, plot) = area.split_vertically(px(78));
    top.draw(&Text::new(title.to_owned(), (px(24) as i32, px(16) as i32), text(26, INK))).map_err(drawing)?;
    top.draw(&Text::new(note.to_owned(), (px(24) as i32, px(50) as i32), text(17, FAINT))).map_err(drawing)?;
    draw_legend(&top, legend, 24, 18)?;
    Ok(plot)
}

pub(crate) fn panel_legend(panel: &Area, legend: &[(&str, RGBColor)]) -> Result<(), ReportError> {
    draw_legend(panel, legend, 30, 14)
}

/// A row of named colours, ending `right` shown pixels from the right edge, `top` from the top.
fn draw_legend(area: &Area, legend: &[(&str, RGBColor)], right: u32, top: u32) -> Result<(), ReportError> {
    let style = text(18, INK);
    let (mut x, top) = (area.dim_in_pixel().0 as i32 - px(right) as i32, px(top) as i32);
    for (name, colour) in legend.iter().rev() {
        let (width, height) = area.estimate_text_size(name, &style).map_err(drawing)?;
        x -= width as i32;
        area.draw(&Text::new((*name).to_owned(), (x, top), style.clone())).map_err(drawing)?;
        x -= px(34) as i32;
        let middle = top + height as i32 / 2 - px(1) as i32;
        let mark = [(x, middle - px(3) as i32), (x + px(24) as i32, middle + px(3) as i32)];
        area.draw(&Rectangle::new(mark, colour.filled())).map_err(drawing)?;
        x -= px(26) as i32;
    }
    Ok(())
}
