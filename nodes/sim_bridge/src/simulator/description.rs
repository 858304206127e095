//! The robot's URDF written as MuJoCo's own format (MJCF).
//!
//! Contact settings are those of a stiff rubber foot on a hard floor: `solref` 0.005 s critically damped, `solimp`
//! 0.95–0.99 over 1 mm, elliptic friction cone, `impratio` 10. Shapes of a link's `<collision>` touch the ground: toes, knees
//! and torso. Toes and torso touch each other as well; nothing else of the robot does.

use super::{SimulatorError, SimulatorOptions};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use std::collections::{HashMap, HashSet};
use std::fmt::Write as _;
use urdf_rs::{Geometry, JointType, Link, Material, Pose};

/// What of the robot MuJoCo needs beyond the URDF.
pub(super) struct Names<'a> {
    /// The twelve actuated joints in the project's order.
    pub joints: &'a [String],
    /// The toes' links.
    pub toes: &'a [String],
}

/// Name of the base body in the MJCF.
pub(super) const BASE: &str = "base";
/// Name of the place that the inertial measurement unit is at.
pub(super) const IMU: &str = "imu";

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

fn shape(link: &str, geometry: &Geometry) -> Result<String, SimulatorError> {
    Ok(match geometry {
        Geometry::Box { size } => format!(r#"type="box" size="{}""#, numbers(&size.0.map(|s| 0.5 * s))),
        Geometry::Cylinder { radius, length } => format!(r#"type="cylinder" size="{radius} {}""#, 0.5 * length),
        Geometry::Capsule { radius, length } => format!(r#"type="capsule" size="{radius} {}""#, 0.5 * length),
        Geometry::Sphere { radius } => format!(r#"type="sphere" size="{radius}""#),
        Geometry::Mesh { filename, .. } => {
            return Err(SimulatorError::Urdf(format!(
                "link \"{link}\" has the mesh \"{filename}\"; the simulator draws boxes, cylinders, capsules and spheres: use those"
            )));
        }
    })
}

struct Writer<'a> {
    robot: &'a urdf_rs::Robot,
    colors: HashMap<&'a str, [f64; 4]>,
    toes: HashSet<&'a str>,
    text: String,
    joints_met: HashSet<&'a str>,
}

impl<'a> Writer<'a> {
    fn inertial(&mut self, link: &Link) {
        let inertial = &link.inertial;
        if inertial.mass.value == 0.0 {
            return;
        }
        let i = &inertial.inertia;
        let about_own_axes = Matrix3::new(i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz);
        let turn: Rotation3<f64> = rotation(&inertial.origin.rpy).into();
        let m = turn * about_own_axes * turn.transpose();
        let (pos, mass) = (numbers(&inertial.origin.xyz.0), inertial.mass.value);
        let products = [m[(0, 1)], m[(0, 2)], m[(1, 2)]];
        let moments = [m[(0, 0)], m[(1, 1)], m[(2, 2)]];
        let inertia = if products == [0.0; 3] {
            format!(r#"diaginertia="{}""#, numbers(&moments))
        } else {
            format!(r#"fullinertia="{} {}""#, numbers(&moments), numbers(&products))
        };
        let _ = write!(self.text, r#"<inertial pos="{pos}" mass="{mass}" {inertia}/>"#);
    }

    fn color(&self, material: Option<&Material>) -> [f64; 4] {
        material
            .and_then(|m| m.color.as_ref().map(|c| c.rgba.0).or_else(|| self.colors.get(m.name.as_str()).copied()))
            .unwrap_or([0.6, 0.6, 0.6, 1.0])
    }

    fn shapes(&mut self, link: &'a Link, of_trunk: bool) -> Result<(), SimulatorError> {
        for visual in &link.visual {
            let _ = write!(
                self.text,
                r#"<geom class="seen" {} {} rgba="{}"/>"#,
                shape(&link.name, &visual.geometry)?,
                place(&visual.origin),
                numbers(&self.color(visual.material.as_ref()))
            );
        }
        let is_toe = self.toes.contains(link.name.as_str());
        if is_toe && (link.collision.len() != 1 || !matches!(link.collision[0].geometry, Geometry::Sphere { .. })) {
            return Err(SimulatorError::Urdf(format!(
                "toe link \"{}\" has {} collision shapes; expected one sphere",
                link.name,
                link.collision.len()
            )));
        }
        for collision in &link.collision {
            let name = if is_toe { format!(r#"name="{}""#, escape(&link.name)) } else { String::new() };
            let _ = write!(
                self.text,
                r#"<geom class="{}" {name} {} {}/>"#,
                match (is_toe, of_trunk) {
                    (true, _) => "toe",
                    (false, true) => "trunk",
                    (false, false) => "leg",
                },
                shape(&link.name, &collision.geometry)?,
                place(&collision.origin),
            );
        }
        Ok(())
    }

    fn link(&mut self, name: &str, of_trunk: bool) -> Result<(), SimulatorError> {
        let robot = self.robot;
        let link = robot.links.iter().find(|l| l.name == name).ok_or_else(|| {
            SimulatorError::Urdf(format!("a joint names the link \"{name}\", which the URDF does not have"))
        })?;
        self.inertial(link);
        self.shapes(link, of_trunk)?;
        for joint in robot.joints.iter().filter(|j| j.parent.link == name) {
            let _ = write!(self.text, r#"<body name="{}" {}>"#, escape(&joint.child.link), place(&joint.origin));
            match joint.joint_type {
                JointType::Fixed => {}
                JointType::Revolute | JointType::Continuous => {
                    let axis = Vector3::from(joint.axis.xyz.0);
                    if axis.norm() < 1e-9 {
                        return Err(SimulatorError::Urdf(format!("joint \"{}\" has the axis 0 0 0", joint.name)));
                    }
                    let range = if joint.joint_type == JointType::Revolute {
                        format!(r#"range="{} {}""#, joint.limit.lower, joint.limit.upper)
                    } else {
                        String::new()
                    };
                    let _ = write!(
                        self.text,
                        r#"<joint name="{}" axis="{}" {range}/>"#,
                        escape(&joint.name),
                        numbers(axis.normalize().as_slice())
                    );
                    self.joints_met.insert(&joint.name);
                }
                ref other => {
                    return Err(SimulatorError::Urdf(format!(
                        "joint \"{}\" is {other:?}; the simulator knows revolute, continuous and fixed joints",
                        joint.name
                    )));
                }
            }
            self.link(&joint.child.link, of_trunk && joint.joint_type == JointType::Fixed)?;
            self.text += "</body>";
        }
        Ok(())
    }
}

/// The whole MJCF: options, floor, light, robot, motors and sensors.
pub(super) fn mjcf(urdf: &str, names: &Names, options: &SimulatorOptions) -> Result<String, SimulatorError> {
    let robot = urdf_rs::read_from_string(urdf).map_err(|e| SimulatorError::Urdf(e.to_string()))?;
    let children: HashSet<&str> = robot.joints.iter().map(|j| j.child.link.as_str()).collect();
    let roots: Vec<&str> = robot.links.iter().map(|l| l.name.as_str()).filter(|l| !children.contains(l)).collect();
    let [root] = roots[..] else {
        return Err(SimulatorError::Urdf(format!("expected one root link, found {}: {roots:?}", roots.len())));
    };
    let mut writer = Writer {
        robot: &robot,
        colors: robot.materials.iter().filter_map(|m| Some((m.name.as_str(), m.color.as_ref()?.rgba.0))).collect(),
        toes: names.toes.iter().map(String::as_str).collect(),
        text: String::new(),
        joints_met: HashSet::new(),
    };
    writer.link(root, true)?;
    let (bodies, joints_met) = (writer.text, writer.joints_met);
    if let Some(missing) = names.joints.iter().find(|n| !joints_met.contains(n.as_str())) {
        return Err(SimulatorError::Urdf(format!(
            "joint \"{missing}\" of the robot file is not a moving joint of the URDF"
        )));
    }
    let link_names: HashSet<&str> = robot.links.iter().map(|l| l.name.as_str()).collect();
    if let Some(missing) = names.toes.iter().find(|n| !link_names.contains(n.as_str())) {
        return Err(SimulatorError::Urdf(format!("toe link \"{missing}\" of the robot file is not in the URDF")));
    }
    let motors: String = names.joints.iter().map(|j| format!(r#"<motor joint="{}"/>"#, escape(j))).collect();
    let (terrain_assets, terrain) = options.terrain.mjcf();
    let gravity = numbers(&options.terrain.gravity_m_s2());
    let SimulatorOptions { timestep_s, friction, .. } = options;
    let (shadow_pixels, samples) = if options.fine_pictures { (4096, 8) } else { (0, 0) };
    Ok(format!(
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
</asset>
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
    ))
}
