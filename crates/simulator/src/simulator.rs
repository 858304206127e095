//! The robot in MuJoCo: [`Simulator`].

mod accelerometer;
mod fall;
mod toe_forces;

use crate::meshes::Meshes;
use crate::{MUJOCO_VERSION, Posture, Push, Random, RobotState, SimulatorError, SimulatorOptions, description};
use gait::Gait;
use joints::{JOINTS, JointCommand, LEGS};
use mujoco_rs::prelude::{MjData, MjModel, MjtObjBase};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use robot::Robot;

/// How long a robot that is put down sitting sinks before time begins, s.
const SINKING_S: f64 = 1.5;

/// MuJoCo, the robot in it and its drives.
pub struct Simulator {
    pub(crate) data: MjData<Box<MjModel>>,
    options: SimulatorOptions,
    /// Index of each joint in MuJoCo's position and velocity vectors.
    position_at: [usize; JOINTS],
    velocity_at: [usize; JOINTS],
    toe_geoms: [usize; LEGS],
    base_body: usize,
    toe_radius_m: f64,
    torque_limit_nm: [f64; JOINTS],
    stand_rad: [f64; JOINTS],
    sit_rad: [f64; JOINTS],
    robot_name: String,
    joint_names: [String; JOINTS],
    damping: JointCommand,
    command: JointCommand,
    commanded_at_step: Option<u64>,
    rejected_commands: u64,
    step: u64,
    accumulated: accelerometer::Accumulated,
    torque_nm: [f64; JOINTS],
    pushes: Vec<Push>,
    first_height_m: f64,
    gravity: Vector3<f64>,
    notes: Vec<String>,
}

impl std::fmt::Debug for Simulator {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Simulator")
            .field("robot", &self.robot_name)
            .field("options", &self.options)
            .field("step", &self.step)
            .finish_non_exhaustive()
    }
}

/// The robot in MuJoCo, and what of its description is not in there. Where MuJoCo refuses the model with meshes, it
/// gets it without: a picture is no reason not to walk.
fn load(robot: &Robot, options: &SimulatorOptions) -> Result<(MjModel, Vec<String>), SimulatorError> {
    let written = description::mjcf(robot, options, Meshes::of(robot.folder.as_deref()))?;
    let refused = match MjModel::from_xml_string(&written.text) {
        Ok(model) => return Ok((model, written.notes)),
        Err(refused) => SimulatorError::Model(refused.to_string()),
    };
    if !written.has_meshes {
        return Err(refused);
    }
    let bare = description::mjcf(robot, options, Meshes::none())?;
    let model = MjModel::from_xml_string(&bare.text).map_err(|e| SimulatorError::Model(e.to_string()))?;
    let mut notes = bare.notes;
    notes.push(format!("no mesh is used, because {refused}"));
    Ok((model, notes))
}

impl Simulator {
    /// Writes the robot's model, loads it into MuJoCo and puts the robot down standing.
    pub fn new(robot: &Robot, options: SimulatorOptions) -> Result<Self, SimulatorError> {
        let found = mujoco_rs::mujoco_version();
        if found != MUJOCO_VERSION {
            return Err(SimulatorError::Version { found: found.into() });
        }
        options.check()?;
        let joint_names = robot.joint_names();
        let toes: [String; LEGS] = std::array::from_fn(|leg| robot.model.frame_name(robot.legs[leg].toe).to_owned());
        let (mut model, notes) = load(robot, &options)?;
        let heights = options.terrain.heights(options.seed);
        if !heights.is_empty() {
            model.hfield_data_mut().copy_from_slice(&heights);
        }
        let id = |kind: MjtObjBase, name: &str| {
            model
                .name_to_id(kind, name)
                .ok_or_else(|| SimulatorError::Model(format!("\"{name}\" is not in the model that we wrote")))
        };
        let mut position_at = [0; JOINTS];
        let mut velocity_at = [0; JOINTS];
        for (j, name) in joint_names.iter().enumerate() {
            let joint = id(MjtObjBase::mjOBJ_JOINT, &description::own(name))?;
            position_at[j] = model.jnt_qposadr()[joint] as usize;
            velocity_at[j] = model.jnt_dofadr()[joint] as usize;
        }
        let mut toe_geoms = [0; LEGS];
        for (leg, name) in toes.iter().enumerate() {
            toe_geoms[leg] = id(MjtObjBase::mjOBJ_GEOM, &description::own(name))?;
        }
        let base_body = id(MjtObjBase::mjOBJ_BODY, description::BASE)?;
        let per_joint = |of_leg: [f64; 3]| std::array::from_fn(|j| of_leg[j % 3]);
        let damping = JointCommand {
            position_rad: [0.0; JOINTS],
            velocity_rad_s: [0.0; JOINTS],
            kp: [0.0; JOINTS],
            kd: per_joint(robot.gains.kd_nm_s_per_rad),
            torque_nm: [0.0; JOINTS],
        };
        let gravity = Vector3::from(options.terrain.gravity_m_s2());
        let mut simulator = Self {
            data: MjData::new(Box::new(model)),
            position_at,
            velocity_at,
            toe_geoms,
            base_body,
            toe_radius_m: robot.toe_radius_m,
            torque_limit_nm: per_joint(robot.limits.drive_torque_nm),
            stand_rad: robot.stand_rad(),
            sit_rad: robot.sit_rad(),
            robot_name: robot.name.clone(),
            joint_names,
            command: damping,
            damping,
            commanded_at_step: None,
            rejected_commands: 0,
            step: 0,
            accumulated: accelerometer::Accumulated::default(),
            torque_nm: [0.0; JOINTS],
            pushes: Vec::new(),
            first_height_m: 0.0,
            gravity,
            options,
            notes,
        };
        simulator.reset_to_posture(Posture::Stand);
        Ok(simulator)
    }

    /// The options that the simulator was built with.
    pub fn options(&self) -> &SimulatorOptions {
        &self.options
    }

    /// What of the robot's description is not simulated as it says, a line each, for a person to read.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Total mass in MuJoCo's model, kg.
    pub fn total_mass_kg(&self) -> f64 {
        self.data.model().totalmass()
    }

    /// Commands that were not finite or had a negative gain since the reset.
    pub fn rejected_commands(&self) -> u64 {
        self.rejected_commands
    }

    fn start_over(&mut self) {
        self.data.reset();
        self.step = 0;
        self.accumulated = accelerometer::Accumulated::default();
        self.command = self.damping;
        self.commanded_at_step = None;
        self.rejected_commands = 0;
        self.torque_nm = [0.0; JOINTS];
        self.pushes.clear();
    }

    fn start_noise(&self) -> [f64; JOINTS] {
        // Its own stream, so that the start does not depend on whether the terrain drew numbers too.
        let mut random = Random::new(self.options.seed ^ 0x5eed_0000_0000_0001);
        std::array::from_fn(|_| self.options.joint_noise_rad * random.normal())
    }

    /// Puts the robot down level at the world's origin, its lowest toe touching the ground, everything at rest. A
    /// sitting robot first sinks onto its belly with damped joints, as one that lies there switched off. Pushes that
    /// were set are forgotten.
    pub fn reset_to_posture(&mut self, posture: Posture) {
        self.start_over();
        let angles = match posture {
            Posture::Stand => self.stand_rad,
            Posture::Sit => self.sit_rad,
        };
        let noise = self.start_noise();
        let qpos = self.data.qpos_mut();
        qpos[..7].copy_from_slice(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
        for j in 0..JOINTS {
            qpos[self.position_at[j]] = angles[j] + noise[j];
        }
        self.data.kinematics();
        let lowest = self.toe_geoms.iter().map(|&toe| self.data.geom_xpos()[toe][2]).fold(f64::INFINITY, f64::min);
        let lift_m = self.options.terrain.lift_m(&self.toe_positions_m());
        self.data.qpos_mut()[2] = self.toe_radius_m - lowest + lift_m;
        self.first_height_m = -lowest;
        self.data.forward();
        if posture == Posture::Sit {
            let steps = (SINKING_S / self.options.timestep_s).round() as u64;
            for _ in 0..steps {
                self.step();
            }
            // Rest, and time zero.
            self.data.qvel_mut().fill(0.0);
            self.data.forward();
            self.step = 0;
            self.torque_nm = [0.0; JOINTS];
        }
    }

    /// Puts the robot down in the gait's initial state (its base height is above the floor, its base velocity in the
    /// world, its angular velocity in the body). Pushes that were set are forgotten.
    pub fn reset_to_gait(&mut self, gait: &Gait) -> Result<(), SimulatorError> {
        gait.check_robot(&self.robot_name, &self.joint_names)?;
        self.start_over();
        let (initial, noise) = (&gait.initial, self.start_noise());
        let [x, y, z] = initial.base_position_m;
        let [qx, qy, qz, qw] = initial.base_quaternion_xyzw;
        let qpos = self.data.qpos_mut();
        qpos[..7].copy_from_slice(&[x, y, z, qw, qx, qy, qz]);
        for j in 0..JOINTS {
            qpos[self.position_at[j]] = initial.joint_position_rad[j] + noise[j];
        }
        let qvel = self.data.qvel_mut();
        qvel[..3].copy_from_slice(&initial.base_linear_velocity_world);
        qvel[3..6].copy_from_slice(&initial.base_angular_velocity_body);
        for j in 0..JOINTS {
            qvel[self.velocity_at[j]] = initial.joint_velocity_rad_s[j];
        }
        self.first_height_m = z - self.toe_radius_m;
        self.data.kinematics();
        self.data.qpos_mut()[2] = z + self.options.terrain.lift_m(&self.toe_positions_m());
        self.data.forward();
        Ok(())
    }

    /// Shows the robot in a given pose, at rest, without physics: for pictures.
    pub fn pose(
        &mut self,
        base_position_m: [f64; 3],
        roll_pitch_yaw_rad: [f64; 3],
        joint_position_rad: &[f64; JOINTS],
    ) {
        let [roll, pitch, yaw] = roll_pitch_yaw_rad;
        let q = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        let [x, y, z] = base_position_m;
        let qpos = self.data.qpos_mut();
        qpos[..7].copy_from_slice(&[x, y, z, q.w, q.i, q.j, q.k]);
        for j in 0..JOINTS {
            qpos[self.position_at[j]] = joint_position_rad[j];
        }
        self.data.qvel_mut().fill(0.0);
        self.data.forward();
    }

    /// Adds a push. It acts while start ≤ time < start + duration.
    pub fn push(&mut self, push: Push) -> Result<(), SimulatorError> {
        let numbers = [push.start_s, push.duration_s, push.force_n[0], push.force_n[1], push.force_n[2]];
        if numbers.iter().any(|v| !v.is_finite()) || push.duration_s < 0.0 {
            return Err(SimulatorError::Option(format!(
                "push {push:?} needs finite numbers and a duration of 0 or more"
            )));
        }
        self.pushes.push(push);
        Ok(())
    }

    /// Gives the drives a new command, which they hold until the next. A command with a number that is not finite or
    /// with a negative gain is refused: the drives damp until a good one comes, and the refusal is counted.
    pub fn command(&mut self, command: &JointCommand) {
        let lists = [&command.position_rad, &command.velocity_rad_s, &command.kp, &command.kd, &command.torque_nm];
        let finite = lists.iter().all(|list| list.iter().all(|v| v.is_finite()));
        let stiff = command.kp.iter().chain(&command.kd).all(|&gain| gain >= 0.0);
        if finite && stiff {
            self.command = *command;
            self.command.kp = command.kp.map(|kp| kp * self.options.variation.stiffness_scale);
        } else {
            self.rejected_commands += 1;
            self.command = self.damping;
        }
        self.commanded_at_step = Some(self.step);
    }

    /// Whether the drives damp for want of a command that is young enough.
    pub fn command_is_stale(&self) -> bool {
        self.commanded_at_step
            .is_none_or(|at| (self.step - at) as f64 * self.options.timestep_s >= self.options.command_timeout_s)
    }

    /// One physics step: the drives' law on the present joint state, its limits, pushes, MuJoCo.
    pub fn step(&mut self) {
        let command = if self.command_is_stale() { &self.damping } else { &self.command };
        let (position, velocity) = self.joints();
        let torque = command.torque(&position, &velocity);
        self.step_with_torque(&torque);
    }

    /// One physics step with torques that come from elsewhere (emulated drives), limited to what the drives can give,
    /// Nm.
    pub fn step_with_torque(&mut self, torque: &[f64; JOINTS]) {
        for j in 0..JOINTS {
            // A torque that is not finite can only come from a state that is not: it must not reach MuJoCo either.
            let limited = torque[j].clamp(-self.torque_limit_nm[j], self.torque_limit_nm[j]);
            self.torque_nm[j] = if limited.is_finite() { limited } else { 0.0 };
        }
        self.data.ctrl_mut().copy_from_slice(&self.torque_nm);
        let now = self.time_s();
        let mut wrench = [0.0; 6];
        for push in self.pushes.iter().filter(|p| (p.start_s..p.start_s + p.duration_s).contains(&now)) {
            for axis in 0..3 {
                wrench[axis] += push.force_n[axis];
            }
        }
        self.data.xfrc_applied_mut()[self.base_body] = wrench;
        self.data.step();
        self.step += 1;
        self.accumulate_specific_force();
    }

    /// Simulated time since the reset, s.
    pub fn time_s(&self) -> f64 {
        self.step as f64 * self.options.timestep_s
    }

    /// Joint positions, rad, and velocities, rad/s.
    pub fn joints(&self) -> ([f64; JOINTS], [f64; JOINTS]) {
        let (qpos, qvel) = (self.data.qpos(), self.data.qvel());
        (std::array::from_fn(|j| qpos[self.position_at[j]]), std::array::from_fn(|j| qvel[self.velocity_at[j]]))
    }

    /// The robot now. Torques and forces are those of the last physics step.
    pub fn state(&self) -> RobotState {
        let (qpos, qvel) = (self.data.qpos(), self.data.qvel());
        let (joint_position_rad, joint_velocity_rad_s) = self.joints();
        RobotState {
            step: self.step,
            time_s: self.time_s(),
            base_position_m: [qpos[0], qpos[1], qpos[2]],
            base_quaternion_xyzw: [qpos[4], qpos[5], qpos[6], qpos[3]],
            base_linear_velocity_world: [qvel[0], qvel[1], qvel[2]],
            base_angular_velocity_body: [qvel[3], qvel[4], qvel[5]],
            base_specific_force_body: self.specific_force_body(),
            joint_position_rad,
            joint_velocity_rad_s,
            joint_torque_nm: self.torque_nm,
            toe_force_n: self.toe_forces(),
        }
    }

    /// Orientation of the base against the true vertical, (x, y, z, w): what an inertial measurement unit reports. It
    /// is the base's orientation in the world except on slopes, where the world's z axis is the ground's normal.
    pub fn imu_quaternion_xyzw(&self) -> [f64; 4] {
        let qpos = self.data.qpos();
        let in_world = UnitQuaternion::from_quaternion(Quaternion::new(qpos[3], qpos[4], qpos[5], qpos[6]));
        let upright = UnitQuaternion::rotation_between(&-self.gravity, &Vector3::z()).unwrap_or_default();
        let q = upright * in_world;
        [q.i, q.j, q.k, q.w]
    }

    /// Centres of the toe spheres in the world, m.
    pub fn toe_positions_m(&self) -> [[f64; 3]; LEGS] {
        self.toe_geoms.map(|toe| self.data.geom_xpos()[toe])
    }

    /// MuJoCo's data, for drawing.
    pub(crate) fn data_mut(&mut self) -> &mut MjData<Box<MjModel>> {
        &mut self.data
    }
}
