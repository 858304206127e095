//! The whole robot as a hybrid system: eq. 1 between events, eq. 2 at touchdown.
//!
//! The integrator is the Dormand–Prince pair of orders 5 and 4 (J. R. Dormand and P. J. Prince, *A
//! family of embedded Runge–Kutta formulae*, 1980) with step-size control. Steps end exactly at the
//! output times asked for and at events; an event's time is found by taking the step itself shorter,
//! not by interpolation, so the state there has the integrator's own accuracy.

use rigid_body::{FrameId, Model, forward_kinematics, frame_position};

use crate::DynamicsError;
use crate::contact::ContactDynamics;

/// Settings of the integrator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Error allowed in a step, relative to the state.
    pub relative_tolerance: f64,
    /// Error allowed in a step, absolute (m, rad, m/s, rad/s).
    pub absolute_tolerance: f64,
    /// Longest step, s: shorter than the shortest time a toe may be below ground unnoticed.
    pub longest_step_s: f64,
    /// Steps after which to give up.
    pub most_steps: usize,
    /// Height of the ground under a toe's frame (the toe's radius if the frame is its centre), m.
    pub ground_m: f64,
    /// A toe must have been this high above the ground before its touchdown counts, m.
    pub arming_height_m: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            relative_tolerance: 1e-9,
            absolute_tolerance: 1e-9,
            longest_step_s: 5e-3,
            most_steps: 1_000_000,
            ground_m: 0.0,
            arming_height_m: 1e-4,
        }
    }
}

impl Options {
    fn check(&self) -> Result<(), DynamicsError> {
        let positive = [
            ("relative_tolerance", self.relative_tolerance),
            ("absolute_tolerance", self.absolute_tolerance),
            ("longest_step_s", self.longest_step_s),
        ];
        for (name, value) in positive {
            if !(value > 0.0 && value.is_finite()) {
                return Err(DynamicsError::BadOption { name, value, expected: "a positive number" });
            }
        }
        for (name, value) in [("ground_m", self.ground_m), ("arming_height_m", self.arming_height_m)] {
            if !value.is_finite() {
                return Err(DynamicsError::BadOption { name, value, expected: "a finite number" });
            }
        }
        Ok(())
    }
}

/// Time, q and q̇.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Time, s.
    pub time_s: f64,
    /// q, dof entries.
    pub q: Vec<f64>,
    /// q̇, dof entries.
    pub v: Vec<f64>,
}

/// Why a phase ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// The time was up.
    Time,
    /// A swing toe reached the ground: its place in the list of swing toes.
    Touchdown(usize),
}

/// A phase of constant contacts.
#[derive(Debug, Clone, PartialEq)]
pub struct Phase {
    /// States at the output times that lie in the phase, and at its end.
    pub states: Vec<State>,
    /// Why it ended.
    pub end: End,
    /// Steps taken, rejected ones not counted.
    pub steps: usize,
}

impl Phase {
    /// The state at the end.
    pub fn last(&self) -> &State {
        self.states.last().expect("a phase has at least the state at its end")
    }
}

/// A controller: writes the joint torques (dof − 6 entries, N m) for a time, q and q̇. It may be called
/// at any time inside a step, and again for the same one.
pub trait Controller: FnMut(f64, &[f64], &[f64], &mut [f64]) {}
impl<F: FnMut(f64, &[f64], &[f64], &mut [f64])> Controller for F {}

/// What a phase consists of.
#[derive(Debug, Clone, Copy)]
pub struct Contacts<'a> {
    /// Toes that stand where they are.
    pub stance: &'a [FrameId],
    /// Toes whose touchdown ends the phase. Empty: the phase ends by time alone.
    pub swing: &'a [FrameId],
}

/// Simulates one phase of a floating-base model from `start` until `end_time_s` or the first
/// touchdown of a swing toe, whichever comes first.
///
/// # Errors
///
/// If an option is out of range, the controller returns NaN, a posture is singular, or the steps
/// become too small or too many.
///
/// # Panics
///
/// If the state does not have `dof` entries.
pub fn simulate_phase(
    model: &Model,
    start: &State,
    end_time_s: f64,
    contacts: Contacts,
    output_times_s: &[f64],
    options: &Options,
    mut controller: impl Controller,
) -> Result<Phase, DynamicsError> {
    options.check()?;
    let n = model.dof();
    let mut system = System {
        model,
        dynamics: ContactDynamics::new(model, contacts.stance.len()),
        data: rigid_body::Data::new(model),
        contacts,
        zero: vec![0.0; n],
        tau: vec![0.0; n],
        controller: &mut controller,
        ground_m: options.ground_m,
    };
    let mut stepper = Stepper::new(2 * n);
    let mut time = start.time_s;
    let mut x: Vec<f64> = start.q.iter().chain(&start.v).copied().collect();
    assert_eq!(x.len(), 2 * n, "the state has the wrong length");
    let state = |time_s: f64, x: &[f64]| State { time_s, q: x[..n].to_vec(), v: x[n..].to_vec() };

    let mut armed = vec![false; contacts.swing.len()];
    let mut heights = vec![0.0; contacts.swing.len()];
    let mut states = Vec::new();
    let mut outputs = output_times_s.iter().copied().filter(|&t| t > start.time_s).peekable();
    let mut step = options.longest_step_s.min(1e-3);
    let mut steps = 0;
    let mut attempts = 0;
    stepper.begin(&mut system, time, &x)?;
    while time < end_time_s {
        while outputs.next_if(|&t| t <= time).is_some() {}
        let target = outputs.peek().map_or(end_time_s, |&t| t.min(end_time_s));
        let (clipped, last) = if time + step * (1.0 + 1e-9) >= target { (target - time, true) } else { (step, false) };
        attempts += 1;
        if attempts > options.most_steps {
            return Err(DynamicsError::TooManySteps { time_s: time, steps: attempts - 1 });
        }
        if clipped < 1e-14 * time.abs().max(1e-3) && !last {
            return Err(DynamicsError::StepTooSmall { time_s: time, step_s: clipped });
        }
        let error = stepper.attempt(&mut system, time, &x, clipped, options)?;
        let factor = (0.9 * error.max(1e-10).powf(-0.2)).clamp(0.2, 5.0);
        if error > 1.0 || error.is_nan() {
            step = clipped * if error.is_nan() { 0.2 } else { factor };
            continue;
        }
        steps += 1;
        if !last {
            step = (step * factor).min(options.longest_step_s);
        } else if factor < 1.0 {
            step = clipped * factor;
        }
        // Did a toe come down within the step?
        system.heights(&stepper.next[..n], &mut heights);
        let first = earliest_touchdown(&mut system, &mut stepper, (time, &x, clipped), &armed, &mut heights, options)?;
        if let Some((touchdown_step, toe)) = first {
            time += touchdown_step;
            x.copy_from_slice(&stepper.next);
            states.push(state(time, &x));
            return Ok(Phase { states, end: End::Touchdown(toe), steps });
        }
        for (armed, height) in armed.iter_mut().zip(&heights) {
            *armed |= *height > options.arming_height_m;
        }
        time = if last { target } else { time + clipped };
        x.copy_from_slice(&stepper.next);
        stepper.accept();
        if last {
            states.push(state(time, &x));
        }
    }
    if states.is_empty() {
        states.push(state(time, &x));
    }
    Ok(Phase { states, end: End::Time, steps })
}

/// The shortest step from x at which an armed toe is at the ground, if one is at or below it after
/// the whole step. Leaves the state at touchdown in `stepper.next`, `heights` as after the whole step.
fn earliest_touchdown(
    system: &mut System,
    stepper: &mut Stepper,
    (time, x, whole): (f64, &[f64], f64),
    armed: &[bool],
    heights: &mut [f64],
    options: &Options,
) -> Result<Option<(f64, usize)>, DynamicsError> {
    let n = x.len() / 2;
    let is_down = |heights: &[f64]| (0..heights.len()).find(|&i| armed[i] && heights[i] <= 0.0);
    let Some(mut toe) = is_down(heights) else { return Ok(None) };
    let (mut above, mut below) = (0.0, whole);
    // Bisection: some toe is down at `below` and none at `above`. 60 halvings reach rounding.
    for _ in 0..60 {
        let middle = 0.5 * (above + below);
        if middle <= above || middle >= below {
            break;
        }
        stepper.attempt(system, time, x, middle, options)?;
        system.heights(&stepper.next[..n], heights);
        match is_down(heights) {
            Some(found) => (below, toe) = (middle, found),
            None => above = middle,
        }
    }
    stepper.attempt(system, time, x, below, options)?;
    Ok(Some((below, toe)))
}

/// The differential equation of a phase.
struct System<'a> {
    model: &'a Model,
    dynamics: ContactDynamics,
    data: rigid_body::Data,
    contacts: Contacts<'a>,
    zero: Vec<f64>,
    tau: Vec<f64>,
    controller: &'a mut dyn Controller,
    ground_m: f64,
}

impl System<'_> {
    fn slope(&mut self, time: f64, x: &[f64], slope: &mut [f64]) -> Result<(), DynamicsError> {
        let (q, v) = x.split_at(x.len() / 2);
        let base = 6.min(self.tau.len());
        (self.controller)(time, q, v, &mut self.tau[base..]);
        if let Some(joint) = self.tau[base..].iter().position(|torque| !torque.is_finite()) {
            let value = self.tau[base + joint];
            return Err(DynamicsError::BadTorque { joint, value, time_s: time });
        }
        let motion = self.dynamics.motion(self.model, q, v, &self.tau, self.contacts.stance)?;
        let (dq, dv) = slope.split_at_mut(q.len());
        dq.copy_from_slice(v);
        dv.copy_from_slice(motion.acceleration.as_slice());
        Ok(())
    }

    fn heights(&mut self, q: &[f64], heights: &mut [f64]) {
        forward_kinematics(self.model, &mut self.data, q, &self.zero, &self.zero);
        for (height, &toe) in heights.iter_mut().zip(self.contacts.swing) {
            *height = frame_position(self.model, &self.data, toe).z - self.ground_m;
        }
    }
}

/// Nodes of the Dormand–Prince pair.
const C: [f64; 7] = [0.0, 1.0 / 5.0, 3.0 / 10.0, 4.0 / 5.0, 8.0 / 9.0, 1.0, 1.0];
/// Its stages; the last row is the fifth-order solution.
const A: [[f64; 6]; 7] = [
    [0.0; 6],
    [1.0 / 5.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    [3.0 / 40.0, 9.0 / 40.0, 0.0, 0.0, 0.0, 0.0],
    [44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0, 0.0, 0.0, 0.0],
    [19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0, 0.0, 0.0],
    [9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0, 0.0],
    [35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
];
/// Fifth-order minus fourth-order weights.
const E: [f64; 7] =
    [71.0 / 57600.0, 0.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339200.0, 22.0 / 525.0, -1.0 / 40.0];

struct Stepper {
    slopes: [Vec<f64>; 7],
    stage: Vec<f64>,
    next: Vec<f64>,
}

impl Stepper {
    fn new(size: usize) -> Self {
        Self { slopes: std::array::from_fn(|_| vec![0.0; size]), stage: vec![0.0; size], next: vec![0.0; size] }
    }

    fn begin(&mut self, system: &mut System, time: f64, x: &[f64]) -> Result<(), DynamicsError> {
        system.slope(time, x, &mut self.slopes[0])
    }

    /// The last slope of an accepted step is the first one of the next.
    fn accept(&mut self) {
        self.slopes.swap(0, 6);
    }

    /// One step from x into `next`; the error estimate in units of the tolerance.
    fn attempt(
        &mut self,
        system: &mut System,
        time: f64,
        x: &[f64],
        step: f64,
        options: &Options,
    ) -> Result<f64, DynamicsError> {
        for k in 1..7 {
            self.stage.copy_from_slice(x);
            for j in 0..k {
                let weight = step * A[k][j];
                for (to, slope) in self.stage.iter_mut().zip(&self.slopes[j]) {
                    *to += weight * slope;
                }
            }
            system.slope(time + C[k] * step, &self.stage, &mut self.slopes[k])?;
        }
        self.next.copy_from_slice(&self.stage);
        let mut sum = 0.0;
        for i in 0..x.len() {
            let error: f64 = (0..7).map(|k| E[k] * self.slopes[k][i]).sum::<f64>() * step;
            let scale = options.absolute_tolerance + options.relative_tolerance * x[i].abs().max(self.next[i].abs());
            sum += (error / scale).powi(2);
        }
        Ok((sum / x.len() as f64).sqrt())
    }
}

/// One step of a walk: a phase and the impact that ends it.
#[derive(Debug, Clone, PartialEq)]
pub struct WalkStep {
    /// The motion, its last state before the impact.
    pub phase: Phase,
    /// The state after the impact.
    pub after: State,
}

/// Simulates a step of a gait whose steps last a fixed time (the tracking law restarts at t = T, paper
/// section IV): the phase until `end_time_s` with `contacts.stance` standing, then the plastic impact
/// of `contacts.swing`, which stand from then on, whether or not they are already at the ground.
///
/// # Errors
///
/// As [`simulate_phase`].
pub fn simulate_step(
    model: &Model,
    start: &State,
    end_time_s: f64,
    contacts: Contacts,
    output_times_s: &[f64],
    options: &Options,
    controller: impl Controller,
) -> Result<WalkStep, DynamicsError> {
    let by_time = Contacts { stance: contacts.stance, swing: &[] };
    let phase = simulate_phase(model, start, end_time_s, by_time, output_times_s, options, controller)?;
    let last = phase.last();
    let mut dynamics = ContactDynamics::new(model, contacts.swing.len());
    let impact = dynamics.impact(model, &last.q, &last.v, contacts.swing)?;
    let after = State { time_s: last.time_s, q: last.q.clone(), v: impact.velocity.as_slice().to_vec() };
    Ok(WalkStep { phase, after })
}
