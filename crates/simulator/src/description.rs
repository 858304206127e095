//! The robot's URDF written as MuJoCo's own format (MJCF).
//!
//! Contact settings are those of a stiff rubber foot on a hard floor: `solref` 0.005 s critically damped, `solimp`
//! 0.95–0.99 over 1 mm, elliptic friction cone, `impratio` 10. Shapes of a link's `<collision>` touch the ground: toes,
//! knees and torso. Toes and torso touch each other as well; nothing else of the robot does.
//!
//! The URDF's own names get a prefix, so that none can be the name of something of ours or of MuJoCo's.

use crate::meshes::Meshes;
use crate::{SimulatorError, SimulatorOptions, Variation};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use rigid_body::Inertia;
use robot::Robot;
use std::collections::{HashMap, HashSet};
use std::fmt::Write as _;
use urdf_rs::{Geometry, Joint, JointType, Link, Material, Pose};

/// The robot's model for MuJoCo.
pub(crate) struct Mjcf {
    /// Its text.
    pub text: String,
    /// What of the robot is not in it, or is not as the URDF says, a line each.
    pub notes: Vec<String>,
    /// Whether there are meshes in it.
    pub has_meshes: bool,
}

/// The name of a URDF's link or joint in the MJCF.
pub(crate) fn own(name: &str) -> String {
    format!("urdf:{name}")
}

/// Name of the base body in the MJCF.
pub(crate) const BASE: &str = "base";
/// Name of the place that the inertial measurement unit is at.
pub(crate) const IMU: &str = "imu";

fn numbers(values: &[f64]) -> String {
    // Rust prints the shortest decimal that reads back as the same number.
    values.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
}

fn rotation(rpy: &[f64; 3]) -> UnitQuaternion<f64> {
    UnitQuaternion::from_euler_angles(rpy[0], rpy[1], rpy[2])
}

fn place(pose: &Pose) -> String {
    let q = rotation(&pose.rpy);
    format!(r#"pos="{}" quat="{}""#, numbers(&pose.xyz.0), numbers(&[q.w, q.i, q.j, q.k]))
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

fn shape(geometry: &Geometry, meshes: &mut Meshes) -> Option<String> {
    Some(match geometry {
        Geometry::Box { size } => format!(r#"type="box" size="{}""#, numbers(&size.0.map(|s| 0.5 * s))),
        Geometry::Cylinder { radius, length } => format!(r#"type="cylinder" size="{radius} {}""#, 0.5 * length),
        Geometry::Capsule { radius, length } => format!(r#"type="capsule" size="{radius} {}""#, 0.5 * length),
        Geometry::Sphere { radius } => format!(r#"type="sphere" size="{radius}""#),
        Geometry::Mesh { filename, scale } => {
            let mesh = meshes.name(filename, scale.as_ref().map_or([1.0; 3], |scale| scale.0))?;
            format!(r#"type="mesh" mesh="{mesh}""#)
        }
    })
}

/// MuJoCo takes no shape without extent.
fn has_extent(geometry: &Geometry) -> bool {
    match geometry {
        Geometry::Box { size } => size.0.iter().all(|&s| s > 0.0),
        Geometry::Cylinder { radius, length } => *radius > 0.0 && *length > 0.0,
        // A capsule without length is a ball, which MuJoCo takes for none.
        Geometry::Capsule { radius, length } => *radius > 0.0 && *length > 0.0,
        Geometry::Sphere { radius } => *radius > 0.0,
        Geometry::Mesh { .. } => true,
    }
}

/// Whether MuJoCo takes the inertia as that of a body: no moment larger than the sum of the others.
fn is_possible(inertia: &urdf_rs::Inertia) -> bool {
    let i = inertia;
    let mut moments: [f64; 3] =
        Matrix3::new(i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz).symmetric_eigenvalues().into();
    moments.sort_by(f64::total_cmp);
    moments[0] > 0.0 && moments[0] + moments[1] >= moments[2]
}

fn inertial(center_m: &[f64; 3], mass_kg: f64, m: &Matrix3<f64>) -> String {
    let pos = numbers(center_m);
    let products = [m[(0, 1)], m[(0, 2)], m[(1, 2)]];
    let moments = [m[(0, 0)], m[(1, 1)], m[(2, 2)]];
    let inertia = if products == [0.0; 3] {
        format!(r#"diaginertia="{}""#, numbers(&moments))
    } else {
        format!(r#"fullinertia="{} {}""#, numbers(&moments), numbers(&products))
    };
    format!(r#"<inertial pos="{pos}" mass="{mass_kg}" {inertia}/>"#)
}

struct Writer<'a> {
    of: &'a Robot,
    robot: &'a urdf_rs::Robot,
    colors: HashMap<&'a str, [f64; 4]>,
    toes: HashSet<&'a str>,
    text: String,
    meshes: Meshes,
    without_ball: Vec<&'a str>,
    joints_met: HashSet<&'a str>,
    variation: Variation,
    /// Moving links whose links, fixed to each other, are written as one body, and that body's inertia.
    merged: HashMap<&'a str, Inertia>,
}

impl<'a> Writer<'a> {
    fn new(of: &'a Robot, options: &SimulatorOptions, meshes: Meshes) -> Self {
        let robot = of.description.robot();
        Self {
            of,
            robot,
            colors: robot.materials.iter().filter_map(|m| Some((m.name.as_str(), m.color.as_ref()?.rgba.0))).collect(),
            toes: of.legs.iter().map(|leg| of.model.frame_name(leg.toe)).collect(),
            text: options.variation.payload(),
            meshes,
            without_ball: Vec::new(),
            joints_met: HashSet::new(),
            variation: options.variation,
            merged: HashMap::new(),
        }
    }

    /// Moving bodies with a link whose own inertia is none that a body can have. Such links do no harm once they are
    /// part of their body, whose inertia the model has checked.
    fn find_merged(&mut self, root: &'a str) {
        let model = &self.of.model;
        // The torso's body is moved by roll, coordinate 3; the other five of the base move no mass.
        for dof in std::iter::once(3).chain(6..model.dof()) {
            let name = if dof == 3 { root } else { model.link_name(dof) };
            let Some(link) = self.robot.links.iter().find(|link| link.name == name) else { continue };
            let mut pending = vec![link.name.as_str()];
            let mut all_possible = true;
            while let Some(name) = pending.pop() {
                let fixed = |joint: &&Joint| joint.parent.link == name && joint.joint_type == JointType::Fixed;
                pending.extend(self.robot.joints.iter().filter(fixed).map(|joint| joint.child.link.as_str()));
                if let Some(link) = self.robot.links.iter().find(|link| link.name == name) {
                    all_possible &= link.inertial.mass.value == 0.0 || is_possible(&link.inertial.inertia);
                }
            }
            if !all_possible {
                self.merged.insert(&link.name, *model.body_inertia(dof));
            }
        }
    }

    fn inertial(&mut self, link: &Link, merged: Option<&Inertia>, is_top: bool, of_trunk: bool) {
        let scale = self.variation.mass_scale;
        let shift = if of_trunk { Vector3::from(self.variation.torso_shift_m) } else { Vector3::zeros() };
        if let Some(body) = merged {
            if is_top {
                let mut m = body.rotational_kg_m2;
                let mut moments: [f64; 3] = m.symmetric_eigenvalues().into();
                moments.sort_by(f64::total_cmp);
                // What rounding in the file took from a flat body, which the model lets pass.
                let lacks = moments[2] - moments[0] - moments[1];
                if lacks > -1e-9 * moments[2] {
                    m += Matrix3::identity() * (lacks.max(0.0) + 1e-9 * moments[2]);
                }
                self.text += &inertial(&(body.center_m + shift).into(), scale * body.mass_kg, &(m * scale));
            }
            return;
        }
        let of_link = &link.inertial;
        if of_link.mass.value == 0.0 {
            return;
        }
        let i = &of_link.inertia;
        let about_own_axes = Matrix3::new(i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz);
        let turn: Rotation3<f64> = rotation(&of_link.origin.rpy).into();
        let m = turn * about_own_axes * turn.transpose();
        let center_m = Vector3::from(of_link.origin.xyz.0) + shift;
        self.text += &inertial(&center_m.into(), scale * of_link.mass.value, &(m * scale));
    }

    fn color(&self, material: Option<&Material>) -> [f64; 4] {
        material
            .and_then(|m| m.color.as_ref().map(|c| c.rgba.0).or_else(|| self.colors.get(m.name.as_str()).copied()))
            .unwrap_or([0.6, 0.6, 0.6, 1.0])
    }

    fn shapes(&mut self, link: &'a Link, of_trunk: bool) {
        let before = self.text.len();
        for visual in link.visual.iter().filter(|visual| has_extent(&visual.geometry)) {
            let Some(shape) = shape(&visual.geometry, &mut self.meshes) else { continue };
            let (at, rgba) = (place(&visual.origin), numbers(&self.color(visual.material.as_ref())));
            let _ = write!(self.text, r#"<geom class="seen" {shape} {at} rgba="{rgba}"/>"#);
        }
        if !link.visual.is_empty() && self.text.len() == before {
            self.bones(link);
        }
        let is_toe = self.toes.contains(link.name.as_str());
        let ball = if is_toe { self.toe(link) } else { None };
        for (number, collision) in link.collision.iter().enumerate() {
            // A toe without a ball stands on robot.toml's alone.
            if (is_toe && ball.is_none()) || Some(number) == ball || !has_extent(&collision.geometry) {
                continue;
            }
            let Some(shape) = shape(&collision.geometry, &mut self.meshes) else { continue };
            let class = if of_trunk { "trunk" } else { "leg" };
            let _ = write!(self.text, r#"<geom class="{class}" {shape} {}/>"#, place(&collision.origin));
        }
    }

    /// Lines from a link's origin to its joints, where none of its own shapes could be drawn.
    fn bones(&mut self, link: &'a Link) {
        /// Half a line's thickness, as a share of the standing height.
        const RADIUS_SHARE: f64 = 0.03;
        let radius_m = RADIUS_SHARE * self.of.nominal.height_m;
        for joint in self.robot.joints.iter().filter(|joint| joint.parent.link == link.name) {
            let to = joint.origin.xyz.0;
            if Vector3::from(to).norm() > 1e-3 {
                let (to, rgba) = (numbers(&to), "0.55 0.60 0.68 1");
                let _ = write!(
                    self.text,
                    r#"<geom class="seen" type="capsule" size="{radius_m}" fromto="0 0 0 {to}" rgba="{rgba}"/>"#
                );
            }
        }
    }

    /// A toe is a ball with robot.toml's radius: where the URDF has its only one, else about the toe link's origin. The
    /// number of the URDF's among the shapes that touch.
    fn toe(&mut self, link: &'a Link) -> Option<usize> {
        let radius_m = self.of.toe_radius_m;
        let ball = self.of.toe_ball(link);
        let origin = match ball {
            Some(number) => place(&link.collision[number].origin),
            None => {
                self.without_ball.push(&link.name);
                place(&Pose::default())
            }
        };
        let name = escape(&own(&link.name));
        let _ = write!(self.text, r#"<geom class="toe" name="{name}" type="sphere" size="{radius_m}" {origin}/>"#);
        ball
    }

    /// One line for all toes without a ball.
    fn note_of_toes(&self) -> Option<String> {
        let links = &self.without_ball;
        (!links.is_empty()).then(|| {
            format!(
                "toe link(s) '{}': not one ball among the shapes that touch; the ground is touched with robot.toml's ball of {} m \
                 radius",
                links.join("', '"),
                self.of.toe_radius_m
            )
        })
    }

    /// A moving joint.
    fn joint(&mut self, joint: &'a Joint) -> Result<(), SimulatorError> {
        let axis = Vector3::from(joint.axis.xyz.0);
        if axis.norm() < 1e-9 {
            return Err(SimulatorError::Urdf(format!("joint \"{}\" has the axis 0 0 0", joint.name)));
        }
        let range = if joint.joint_type == JointType::Revolute && joint.limit.lower < joint.limit.upper {
            format!(r#"range="{} {}""#, joint.limit.lower, joint.limit.upper)
        } else {
            String::new()
        };
        let number = self.of.joint_names().iter().position(|name| *name == joint.name);
        let drive = number.map(|number| self.drive(joint, number % 3)).unwrap_or_default();
        let _ = write!(
            self.text,
            r#"<joint name="{}" axis="{}" {range}{drive}/>"#,
            escape(&own(&joint.name)),
            numbers(axis.normalize().as_slice())
        );
        self.joints_met.insert(&joint.name);
        Ok(())
    }

    /// Rotor inertia, damping and dry friction, where there are any.
    fn drive(&self, joint: &Joint, of_leg: usize) -> String {
        let drives = &self.of.drives;
        let given = joint.dynamics.as_ref();
        let damping = drives.damping_nm_s_per_rad.map_or(given.map_or(0.0, |d| d.damping), |of| of[of_leg]);
        let friction = drives.friction_nm.map_or(given.map_or(0.0, |d| d.friction), |of| of[of_leg]);
        let attributes =
            [("armature", drives.rotor_inertia_kg_m2[of_leg]), ("damping", damping), ("frictionloss", friction)];
        attributes.iter().filter(|(_, v)| *v > 0.0).map(|(name, v)| format!(r#" {name}="{v}""#)).collect()
    }

    /// A link and all below it. `merged` is the inertia of the moving body that it is part of, where that is written as
    /// one.
    fn link(
        &mut self,
        name: &str,
        of_trunk: bool,
        merged: Option<&Inertia>,
        is_top: bool,
    ) -> Result<(), SimulatorError> {
        let robot = self.robot;
        let link = robot.links.iter().find(|l| l.name == name).ok_or_else(|| {
            SimulatorError::Urdf(format!("a joint names the link \"{name}\", which the URDF does not have"))
        })?;
        self.inertial(link, merged, is_top, of_trunk);
        self.shapes(link, of_trunk);
        for joint in robot.joints.iter().filter(|j| j.parent.link == name) {
            let child = joint.child.link.as_str();
            let origin = self.variation.origin(self.of, joint);
            let _ = write!(self.text, r#"<body name="{}" {}>"#, escape(&own(child)), place(&origin));
            match joint.joint_type {
                JointType::Fixed => self.link(child, of_trunk, merged, false)?,
                JointType::Revolute | JointType::Continuous => {
                    self.joint(joint)?;
                    let own = self.merged.get(child).copied();
                    self.link(child, false, own.as_ref(), true)?;
                }
                ref other => {
                    return Err(SimulatorError::Urdf(format!(
                        "joint \"{}\" is {other:?}; the simulator knows revolute, continuous and fixed joints",
                        joint.name
                    )));
                }
            }
            self.text += "</body>";
        }
        Ok(())
    }
}

/// The whole MJCF: options, floor, light, robot, motors and sensors.
pub(crate) fn mjcf(of: &Robot, options: &SimulatorOptions, meshes: Meshes) -> Result<Mjcf, SimulatorError> {
    let robot = of.description.robot();
    let children: HashSet<&str> = robot.joints.iter().map(|j| j.child.link.as_str()).collect();
    let roots: Vec<&str> = robot.links.iter().map(|l| l.name.as_str()).filter(|l| !children.contains(l)).collect();
    let [root] = roots[..] else {
        return Err(SimulatorError::Urdf(format!("expected one root link, found {}: {roots:?}", roots.len())));
    };
    let joint_names = of.joint_names();
    let mut writer = Writer::new(of, options, meshes);
    writer.find_merged(root);
    writer.link(root, true, writer.merged.get(root).copied().as_ref(), true)?;
    let mut notes: Vec<String> = writer.note_of_toes().into_iter().collect();
    let Writer { text: bodies, joints_met, meshes, .. } = writer;
    if let Some(missing) = joint_names.iter().find(|n| !joints_met.contains(n.as_str())) {
        return Err(SimulatorError::Urdf(format!(
            "joint \"{missing}\" of the robot file is not a moving joint of the URDF"
        )));
    }
    let motors: String = joint_names.iter().map(|j| format!(r#"<motor joint="{}"/>"#, escape(&own(j)))).collect();
    let (mesh_assets, has_meshes) = (meshes.assets(), meshes.any());
    notes.extend(meshes.note());
    let (terrain_assets, terrain) = options.terrain.mjcf();
    let gravity = numbers(&options.terrain.gravity_m_s2());
    let SimulatorOptions { timestep_s, friction, .. } = options;
    let (shadow_pixels, samples) = if options.fine_pictures { (4096, 8) } else { (0, 0) };
    let text = format!(
        r#"<mujoco model="{name}">
<compiler angle="radian" autolimits="true"/>
<option timestep="{timestep_s}" gravity="{gravity}" cone="elliptic" integrator="implicitfast" impratio="10"><flag autoreset="disable"/></option>
<visual>
  <global offwidth="1920" offheight="1200" fovy="35"/>
  <quality shadowsize="{shadow_pixels}" offsamples="{samples}"/>
  <headlight ambient="0.42 0.42 0.44" diffuse="0.28 0.28 0.28" specular="0.1 0.1 0.1"/>
  <map znear="0.01" zfar="60" fogstart="5" fogend="16" shadowclip="1.2" shadowscale="0.7"/>
  <rgba haze="0.87 0.90 0.94 1" fog="0.87 0.90 0.94 1"/>
</visual>
<statistic extent="1.5" meansize="0.1"/>
<default>
  <geom contype="1" conaffinity="3" friction="{friction} 0.005 0.0001" solref="0.005 1" solimp="0.95 0.99 0.001" condim="3"/>
  <joint type="hinge" damping="0" armature="0"/>
  <default class="seen"><geom contype="0" conaffinity="0" group="1" mass="0"/></default>
  <default class="trunk"><geom contype="1" conaffinity="0" group="3" mass="0"/></default>
  <default class="leg"><geom contype="2" conaffinity="0" group="3" mass="0"/></default>
  <default class="toe"><geom contype="0" conaffinity="1" group="3" mass="0"/></default>
</default>
<asset>
  <texture name="sky" type="skybox" builtin="gradient" rgb1="0.87 0.90 0.94" rgb2="0.55 0.68 0.82" width="256" height="256"/>
  <texture name="floor" type="2d" builtin="checker" rgb1="0.78 0.80 0.82" rgb2="0.66 0.69 0.72" mark="edge" markrgb="0.86 0.88 0.90" width="512" height="512"/>
  <material name="floor" texture="floor" texrepeat="1 1" texuniform="true" reflectance="0" specular="0.1"/>
  <material name="stair0" rgba="0.70 0.73 0.77 1"/><material name="stair1" rgba="0.62 0.66 0.71 1"/>
  {terrain_assets}
  {mesh_assets}</asset>
<worldbody>
  {terrain}
  <body name="{BASE}"><freejoint/><site name="{IMU}"/>
    <light name="sun" mode="track" type="directional" pos="0.7 -0.9 2" dir="-0.35 0.45 -1" diffuse="0.62 0.61 0.58" specular="0.25 0.25 0.25" castshadow="true"/>
    {bodies}</body>
</worldbody>
<actuator>{motors}</actuator>
<sensor><accelerometer site="{IMU}"/></sensor>
</mujoco>
"#,
        name = escape(&robot.name),
    );
    Ok(Mjcf { text, notes, has_meshes })
}
