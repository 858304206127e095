//! What `tandem simulate` says of a walk.

use super::Done;
use gait::Gait;
use robot::Robot;
use simulator::Terrain;
use simulator::walk::{End, WalkOptions};

/// The paper's torques: the Vision 60's, of no use beside another robot's.
fn paper(robot: &Robot, gait: &Gait) -> Option<::report::TableTwo> {
    ::report::table_two(&robot.name, &gait.name)
}

fn ground(terrain: &Terrain) -> String {
    match terrain {
        Terrain::Flat => "flat ground".into(),
        Terrain::Slope { uphill_rad, sideways_rad } => {
            let (uphill_deg, sideways_deg) = (uphill_rad.to_degrees(), sideways_rad.to_degrees());
            format!("slope {uphill_deg:.1} deg ahead, {sideways_deg:.1} deg to the left")
        }
        Terrain::Rough { height_m, .. } => format!("bumps up to {:.0} mm", 1e3 * height_m),
        Terrain::Steps { rise_m, .. } => format!("stairs of {:.0} mm", 1e3 * rise_m),
        Terrain::Staircase { rise_m, .. } => format!("a staircase of {:.0} mm", 1e3 * rise_m),
        Terrain::Ramp { incline_rad } => format!("a ramp of {:.1} degrees", incline_rad.to_degrees()),
        Terrain::Kerb { height_m } => format!("a kerb of {:.0} mm", 1e3 * height_m),
        Terrain::Hills { incline_rad, bump_m } => {
            format!("hills of {:.1} degrees with bumps up to {:.0} mm", incline_rad.to_degrees(), 1e3 * bump_m)
        }
    }
}

fn end(end: &End) -> String {
    match end {
        End::Upright => "upright to the end".into(),
        End::Fell { at_s, fall } => format!("FELL at {at_s:.3} s: {fall}"),
        End::Fault { at_s, fault } => format!("STOPPED at {at_s:.3} s by a fault: {fault}"),
        End::Stopped { at_s: Some(at_s) } => format!("INTERRUPTED at {at_s:.3} s"),
        End::Stopped { at_s: None } => "INTERRUPTED before the first step".into(),
    }
}

/// A figure, or a mark in its place where the walk was too short for it.
fn known(is_known: bool, value: f64, digits: usize) -> String {
    if is_known { format!("{value:.digits$}") } else { "?".into() }
}

impl Done {
    /// Lines for a person.
    pub(super) fn text(&self, robot: &Robot, gait: &Gait, options: &WalkOptions) -> String {
        let f = &self.walk.figures;
        let (ground, end) = (ground(&options.simulator.terrain), end(&self.walk.end));
        let drives = options.drives.as_ref().map_or(String::new(), |d| {
            format!("  emulated drives on {} buses, latency {:?}\n", d.bus.interfaces.len(), d.model.latency)
        });
        let mut text = format!(
            "{} on {}: {:.3} s steps, {ground}, friction {}, start noise {} rad, seed {}\n  {end} ({:.1} s)\n",
            gait.name,
            robot.name,
            gait.step_duration_s,
            options.simulator.friction,
            options.simulator.joint_noise_rad,
            options.simulator.seed,
            f.time_s
        );
        text += &drives;
        text += &format!(
            "  speed       asked {:.3} m/s{}, got {} m/s ahead and {} m/s to the left\n",
            gait.speed_m_s(),
            aside(gait),
            known(f.speed_known, f.speed_m_s, 3),
            known(f.speed_known, f.lateral_speed_m_s, 3)
        );
        text += &format!(
            "  went        x {:.2} m, y {:.2} m, turned {:.1} deg\n",
            f.drift_m[0], f.drift_m[1], f.turned_deg
        );
        text += &format!(
            "  body        {} m above the toes, roll ±{} deg, pitch {} ±{} deg, largest tilt {:.1} deg\n",
            known(f.settled, f.height_m, 3),
            known(f.settled, f.roll_deviation_deg, 2),
            known(f.settled, f.pitch_mean_deg, 2),
            known(f.settled, f.pitch_deviation_deg, 2),
            f.max_tilt_deg
        );
        let row = |name: &str, [roll, pitch, knee]: [f64; 3]| format!("  {name:24}{roll:9.2}{pitch:11.2}{knee:8.2}\n");
        text += "  mean |torque|, Nm        hip roll  hip pitch    knee\n";
        if f.settled {
            text += &row("  here", f.mean_abs_torque_nm.into());
        }
        if let Some(paper) = paper(robot, gait) {
            text += &row("  Table II, MuJoCo", paper.mujoco_nm);
            text += &row("  Table II, experiment", paper.experiment_nm);
        }
        text += &format!(
            "  largest torque {} Nm; {} % of samples at the drives' limit\n",
            known(f.settled, f.max_torque_nm, 1),
            known(f.settled, 100.0 * f.saturated_share, 2)
        );
        text += &format!("  {} control cycles in {:.2} s of wall time\n", self.walk.cycles, self.wall_s);
        for file in &self.files {
            text += &format!("  wrote {}\n", file.display());
        }
        for note in &self.walk.notes {
            text += &format!("  {note}\n");
        }
        for problem in &self.no_pictures {
            text += &format!("  {problem}\n");
        }
        text
    }

    /// The same for a program; what is not known is null.
    pub(super) fn json(&self, robot: &Robot, gait: &Gait, options: &WalkOptions) -> serde_json::Value {
        let (fell_at_s, fault) = match &self.walk.end {
            End::Upright | End::Stopped { .. } => (None, None),
            End::Fell { at_s, .. } => (Some(*at_s), None),
            End::Fault { at_s, fault } => (Some(*at_s), Some(fault)),
        };
        let paper = paper(robot, gait);
        serde_json::json!({
            "gait": gait.name,
            "step_duration_s": gait.step_duration_s,
            "seed": options.simulator.seed,
            "upright": self.walk.end == End::Upright,
            "fell_at_s": fell_at_s,
            "fault": fault,
            "interrupted": self.interrupted.is_some(),
            "speed_asked_m_s": gait.speed_m_s(),
            "figures": self.walk.figures,
            "table_two_mujoco_nm": paper.map(|p| p.mujoco_nm),
            "walking_from_s": self.walk.has_walked().then_some(self.walk.walking_from_s),
            "cycles": self.walk.cycles,
            "wall_s": self.wall_s,
            "files": self.files,
            "no_pictures": self.no_pictures,
            "notes": self.walk.notes,
        })
    }
}

/// What a gait that turns or steps aside was asked for besides.
fn aside(gait: &Gait) -> String {
    let asked = |field: &str, unit: &str| match gait.request[field].as_f64() {
        Some(value) if value != 0.0 => format!(", {value:.3} {unit}"),
        _ => String::new(),
    };
    asked("lateral_speed_m_s", "m/s to the left") + &asked("yaw_rate_rad_s", "rad/s to the left")
}
