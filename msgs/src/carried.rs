//! How the message carries a gait's values: ROS 2 has lists without a fixed length where a gait has arrays, and
//! structures for poses and velocities.

use gait::bezier::DEGREE;
use gait::{Coefficients, Domain, JOINTS, LEGS, SolverSummary};

use crate::gait_error::GaitMessageError;
use crate::geometry_msgs::{Point, Pose, Quaternion, Twist, Vector3};
use crate::{GaitDomain, SolverReport};

/// Where a value stands, for the message of an error.
#[derive(Clone, Copy)]
pub(crate) struct Place<'a> {
    /// The gait's name.
    pub gait: &'a str,
    /// The message's field.
    pub field: &'a str,
}

/// A gait's value, as the message's type `Wire` carries it.
pub(crate) trait Carried<Wire>: Sized {
    /// What goes into the message.
    fn to_wire(&self) -> Wire;

    /// What came out of it, or which length is wrong.
    fn from_wire(wire: &Wire, place: Place<'_>) -> Result<Self, GaitMessageError>;
}

macro_rules! carried_as_they_are {
    ($($type:ty),+) => { $(
        impl Carried<$type> for $type {
            fn to_wire(&self) -> $type {
                self.clone()
            }
            fn from_wire(wire: &$type, _place: Place<'_>) -> Result<Self, GaitMessageError> {
                Ok(wire.clone())
            }
        }
    )+ };
}
carried_as_they_are! { String, f64, u32, bool }

impl Carried<u8> for usize {
    fn to_wire(&self) -> u8 {
        // A polynomial's degree: 5.
        *self as u8
    }
    fn from_wire(wire: &u8, _place: Place<'_>) -> Result<Self, GaitMessageError> {
        Ok(usize::from(*wire))
    }
}

fn array<T: Clone, const N: usize>(values: &[T], place: Place<'_>) -> Result<[T; N], GaitMessageError> {
    <[T; N]>::try_from(values.to_vec()).map_err(|values| GaitMessageError::Length {
        gait: place.gait.to_owned(),
        field: place.field.to_owned(),
        found: values.len(),
        expected: N,
    })
}

impl<const N: usize> Carried<Vec<f64>> for [f64; N] {
    fn to_wire(&self) -> Vec<f64> {
        self.to_vec()
    }
    fn from_wire(wire: &Vec<f64>, place: Place<'_>) -> Result<Self, GaitMessageError> {
        array(wire, place)
    }
}

impl<const N: usize> Carried<Vec<String>> for [String; N] {
    fn to_wire(&self) -> Vec<String> {
        self.to_vec()
    }
    fn from_wire(wire: &Vec<String>, place: Place<'_>) -> Result<Self, GaitMessageError> {
        array(wire, place)
    }
}

/// Row by row.
impl Carried<Vec<f64>> for [Coefficients; JOINTS] {
    fn to_wire(&self) -> Vec<f64> {
        self.as_flattened().to_vec()
    }
    fn from_wire(wire: &Vec<f64>, place: Place<'_>) -> Result<Self, GaitMessageError> {
        let flat: [f64; JOINTS * (DEGREE + 1)] = array(wire, place)?;
        Ok(std::array::from_fn(|joint| std::array::from_fn(|power| flat[joint * (DEGREE + 1) + power])))
    }
}

/// Legs by number.
impl Carried<Vec<u8>> for [usize; LEGS] {
    fn to_wire(&self) -> Vec<u8> {
        // Below four: a mirror is a permutation of the legs.
        self.iter().map(|leg| *leg as u8).collect()
    }
    fn from_wire(wire: &Vec<u8>, place: Place<'_>) -> Result<Self, GaitMessageError> {
        array(wire, place).map(|legs: [u8; LEGS]| legs.map(usize::from))
    }
}

/// Legs by number.
impl Carried<Vec<u8>> for [bool; LEGS] {
    fn to_wire(&self) -> Vec<u8> {
        (0..LEGS as u8).filter(|leg| self[usize::from(*leg)]).collect()
    }
    fn from_wire(wire: &Vec<u8>, place: Place<'_>) -> Result<Self, GaitMessageError> {
        let mut stands = [false; LEGS];
        for leg in wire {
            let twice = stands.get_mut(usize::from(*leg)).is_none_or(|stands| std::mem::replace(stands, true));
            if twice {
                let (gait, field) = (place.gait.to_owned(), place.field.to_owned());
                return Err(GaitMessageError::StanceLegs { gait, field, found: *leg });
            }
        }
        Ok(stands)
    }
}

impl Carried<Vec<GaitDomain>> for Vec<Domain> {
    fn to_wire(&self) -> Vec<GaitDomain> {
        let domain = |domain: &Domain| GaitDomain {
            stance_legs: domain.stands.to_wire(),
            duration_s: domain.duration_s,
            coefficients_rad: domain.planned_rad.to_wire(),
            reference_coefficients_rad: domain.reference_rad.to_wire(),
        };
        self.iter().map(domain).collect()
    }
    fn from_wire(wire: &Vec<GaitDomain>, place: Place<'_>) -> Result<Self, GaitMessageError> {
        let domain = |(k, domain): (usize, &GaitDomain)| {
            let field = |name: &str| format!("{}[{k}].{name}", place.field);
            let at = |field| Place { gait: place.gait, field };
            Ok(Domain {
                stands: Carried::from_wire(&domain.stance_legs, at(&field("stance_legs")))?,
                duration_s: domain.duration_s,
                planned_rad: Carried::from_wire(&domain.coefficients_rad, at(&field("coefficients_rad")))?,
                reference_rad: Carried::from_wire(
                    &domain.reference_coefficients_rad,
                    at(&field("reference_coefficients_rad")),
                )?,
            })
        };
        wire.iter().enumerate().map(domain).collect()
    }
}

/// As JSON.
impl Carried<String> for serde_json::Value {
    fn to_wire(&self) -> String {
        self.to_string()
    }
    fn from_wire(wire: &String, place: Place<'_>) -> Result<Self, GaitMessageError> {
        serde_json::from_str(wire)
            .map_err(|error| GaitMessageError::Request { gait: place.gait.to_owned(), reason: error.to_string() })
    }
}

/// Position and orientation (x, y, z, w).
impl Carried<Pose> for ([f64; 3], [f64; 4]) {
    fn to_wire(&self) -> Pose {
        let ([x, y, z], [qx, qy, qz, qw]) = *self;
        Pose { position: Point { x, y, z }, orientation: Quaternion { x: qx, y: qy, z: qz, w: qw } }
    }
    fn from_wire(Pose { position: p, orientation: o }: &Pose, _place: Place<'_>) -> Result<Self, GaitMessageError> {
        Ok(([p.x, p.y, p.z], [o.x, o.y, o.z, o.w]))
    }
}

/// Linear and angular velocity.
impl Carried<Twist> for ([f64; 3], [f64; 3]) {
    fn to_wire(&self) -> Twist {
        let vector = |[x, y, z]: [f64; 3]| Vector3 { x, y, z };
        Twist { linear: vector(self.0), angular: vector(self.1) }
    }
    fn from_wire(Twist { linear: l, angular: a }: &Twist, _place: Place<'_>) -> Result<Self, GaitMessageError> {
        Ok(([l.x, l.y, l.z], [a.x, a.y, a.z]))
    }
}

/// A single field of a structure.
impl<Wire, T: Carried<Wire>> Carried<Wire> for (T,) {
    fn to_wire(&self) -> Wire {
        self.0.to_wire()
    }
    fn from_wire(wire: &Wire, place: Place<'_>) -> Result<Self, GaitMessageError> {
        T::from_wire(wire, place).map(|value| (value,))
    }
}

impl Carried<SolverReport> for SolverSummary {
    fn to_wire(&self) -> SolverReport {
        let SolverSummary { status, iterations, solve_time_s, max_violation, objective } = self.clone();
        // A gait that was found violates nothing.
        SolverReport { status, iterations, solve_time_s, max_violation, objective, worst_constraint: String::new() }
    }
    fn from_wire(wire: &SolverReport, _place: Place<'_>) -> Result<Self, GaitMessageError> {
        let SolverReport { status, iterations, solve_time_s, max_violation, objective, worst_constraint: _ } =
            wire.clone();
        Ok(SolverSummary { status, iterations, solve_time_s, max_violation, objective })
    }
}
