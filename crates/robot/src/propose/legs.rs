//! Which joints of a URDF are legs.

use nalgebra::Vector3;
use rigid_body::{Data, Description, Model, forward_kinematics, frame_position, frame_rotation};
use urdf_rs::{Joint, JointType};

use crate::RobotError;

/// Beyond half a turn a leg's joint is where it was: limits are cut there, rad.
const MOST_RAD: f64 = 3.1;

/// One leg found.
#[derive(Debug, Clone)]
pub(super) struct LegFound {
    pub joints: [String; 3],
    pub toe: String,
    pub min_rad: [f64; 3],
    pub max_rad: [f64; 3],
}

/// The legs, in the project's order, and the rest.
#[derive(Debug, Clone)]
pub(super) struct Found {
    pub legs: [LegFound; 4],
    pub joint_sign: [f64; 3],
    pub locked: Vec<(String, f64)>,
    pub look_at: Vec<String>,
}

fn none(problem: String) -> RobotError {
    RobotError::NotFourLegs { problem }
}

fn moves(joint: &Joint) -> bool {
    joint.joint_type != JointType::Fixed
}

/// The moving joints that the body of `link` carries, through fixed joints.
fn moving_below<'a>(robot: &'a urdf_rs::Robot, link: &'a str) -> Vec<&'a Joint> {
    let mut pending = vec![link];
    let mut found = Vec::new();
    while let Some(link) = pending.pop() {
        for joint in robot.joints.iter().filter(|joint| joint.parent.link == link) {
            if moves(joint) {
                found.push(joint);
            } else {
                pending.push(&joint.child.link);
            }
        }
    }
    found
}

/// All moving joints in the tree below and with `joint`.
fn count_below(robot: &urdf_rs::Robot, joint: &Joint) -> usize {
    1 + moving_below(robot, &joint.child.link).into_iter().map(|below| count_below(robot, below)).sum::<usize>()
}

/// Three turning joints in a chain from `first` on, where it is one.
fn chain<'a>(robot: &'a urdf_rs::Robot, first: &'a Joint) -> Option<[&'a Joint; 3]> {
    let turns = |joint: &Joint| matches!(joint.joint_type, JointType::Revolute | JointType::Continuous);
    let next = |joint: &'a Joint| {
        let below = moving_below(robot, &joint.child.link).into_iter().filter(|below| turns(below));
        below.max_by_key(|below| count_below(robot, below))
    };
    let second = next(first)?;
    let third = next(second)?;
    turns(first).then_some([first, second, third])
}

/// Finds the legs, and locks every other joint in the description.
pub(super) fn find(description: &mut Description) -> Result<Found, RobotError> {
    let robot = description.robot().clone();
    let below = |link: &str| robot.joints.iter().any(|joint| joint.child.link == link);
    let root = robot.links.iter().find(|link| !below(&link.name)).map(|link| link.name.clone());
    let root = root.ok_or_else(|| none("it has no root link".to_owned()))?;
    let hips = moving_below(&robot, &root);
    let mut chains: Vec<([&Joint; 3], usize)> =
        hips.iter().filter_map(|hip| Some((chain(&robot, hip)?, count_below(&robot, hip)))).collect();
    if chains.len() > 4 {
        // An arm has another number of joints than the legs.
        let of_count = |count: usize| chains.iter().filter(|(_, other)| *other == count).count();
        let count = chains.iter().map(|&(_, count)| count).find(|&count| of_count(count) == 4);
        chains.retain(|&(_, of)| Some(of) == count);
    }
    if chains.len() != 4 {
        return Err(none(format!(
            "of the {} moving joints at its root link '{root}', {} begin a chain of three turning joints",
            hips.len(),
            chains.len()
        )));
    }
    let of_legs: Vec<&str> =
        chains.iter().flat_map(|(chain, _)| chain.iter().map(|joint| joint.name.as_str())).collect();
    let mut locked = Vec::new();
    for joint in robot.joints.iter().filter(|joint| moves(joint) && !of_legs.contains(&joint.name.as_str())) {
        let (low, high) = (joint.limit.lower, joint.limit.upper);
        let limited = joint.joint_type != JointType::Continuous && low < high;
        let position = if limited && !(low..=high).contains(&0.0) { 0.5 * (low + high) } else { 0.0 };
        description.lock(&joint.name, position)?;
        locked.push((joint.name.clone(), position));
    }
    let model = Model::floating_base(description)?;
    place(&model, description, &chains.iter().map(|(chain, _)| *chain).collect::<Vec<_>>(), locked)
}

/// Puts the legs in order and reads what the mirror does to them.
fn place(
    model: &Model,
    description: &Description,
    chains: &[[&Joint; 3]],
    locked: Vec<(String, f64)>,
) -> Result<Found, RobotError> {
    let mut data = Data::new(model);
    let zero = vec![0.0; model.dof()];
    forward_kinematics(model, &mut data, &zero, &zero, &zero);
    let at = |link: &str| {
        let frame = model.frame_id(link).expect("every link is a frame");
        (frame_position(model, &data, frame), frame_rotation(model, &data, frame))
    };
    let hips: Vec<Vector3<f64>> = chains.iter().map(|chain| at(&chain[0].child.link).0).collect();
    let middle = hips.iter().sum::<Vector3<f64>>() / 4.0;
    let mut order = [0; 4];
    for (number, place) in order.iter_mut().enumerate() {
        let (left, front) = (number < 2, number % 2 == 0);
        let here: Vec<usize> =
            (0..4).filter(|&i| (hips[i].y > middle.y) == left && (hips[i].x > middle.x) == front).collect();
        let [one] = here[..] else {
            return Err(none("its hips are not one at each corner (x ahead, y left)".to_owned()));
        };
        *place = one;
    }
    let axis = |joint: &Joint| at(&joint.child.link).1 * Vector3::from(joint.axis.xyz.0).normalize();
    // The mirror image of a turn about a is a turn about (−a_x, a_y, −a_z).
    let sign = |left: &Joint, right: &Joint| {
        let a = axis(left);
        Vector3::new(-a.x, a.y, -a.z).dot(&axis(right)).signum()
    };
    let signs = [0, 1].map(|i| {
        let (left, right) = (chains[order[i]], chains[order[i + 2]]);
        std::array::from_fn::<f64, 3, _>(|k| sign(left[k], right[k]))
    });
    if signs[0] != signs[1] {
        return Err(none(format!(
            "the mirror's signs are {:?} for the front legs and {:?} for the rear ones; robot.toml has one list for both",
            signs[0], signs[1]
        )));
    }
    let mut look_at = Vec::new();
    for (joint, position) in &locked {
        look_at.push(format!("joint '{joint}' belongs to no leg: locked at {position}"));
    }
    for k in 0..3 {
        let a = axis(chains[order[0]][k]);
        if (if k == 0 { a.x } else { a.y }).abs() < 0.9 {
            let name = &chains[order[0]][k].name;
            look_at.push(format!(
                "joint '{name}' turns about ({:.2}, {:.2}, {:.2}): expected about x for hip roll, y for the others",
                a.x, a.y, a.z
            ));
        }
    }
    let mut legs = Vec::new();
    for &i in &order {
        legs.push(leg(model, description, &chains[i], &mut look_at)?);
    }
    let legs = <[LegFound; 4]>::try_from(legs).expect("four legs");
    Ok(Found { legs, joint_sign: signs[0], locked, look_at })
}

fn leg(
    model: &Model,
    description: &Description,
    chain: &[&Joint; 3],
    look_at: &mut Vec<String>,
) -> Result<LegFound, RobotError> {
    let mut data = Data::new(model);
    let zero = vec![0.0; model.dof()];
    forward_kinematics(model, &mut data, &zero, &zero, &zero);
    let knee = model.joint_index(&chain[2].name).expect("the chain's joints move");
    let shank = model.frame_id(&chain[2].child.link).expect("every link is a frame");
    let from = frame_position(model, &data, shank);
    let distance = |link: &str| {
        let frame = model.frame_id(link).filter(|&frame| model.frame_dof(frame) == Some(knee))?;
        let distance = (frame_position(model, &data, frame) - from).norm();
        (distance > 0.01).then_some(distance)
    };
    let named = |link: &str| {
        let small = link.to_lowercase();
        small.contains("foot") || small.contains("toe")
    };
    let links = description.robot().links.iter().map(|link| link.name.as_str());
    let toe = links
        .filter_map(|link| Some((named(link), distance(link)?, link)))
        .max_by(|a, b| (a.0, a.1).partial_cmp(&(b.0, b.1)).expect("distances are finite"));
    let Some((_, _, toe)) = toe else {
        return Err(none(format!(
            "no link is fixed to the shank '{}' at the toe: add one, <link name=\"…_toe\"/> with a fixed joint",
            chain[2].child.link
        )));
    };
    let (mut min_rad, mut max_rad) = ([-MOST_RAD; 3], [MOST_RAD; 3]);
    for k in 0..3 {
        let limit = &chain[k].limit;
        if chain[k].joint_type == JointType::Revolute && limit.lower < limit.upper {
            min_rad[k] = limit.lower.max(-MOST_RAD);
            max_rad[k] = limit.upper.min(MOST_RAD);
        } else {
            look_at
                .push(format!("joint '{}' has no position limits in the URDF: ±{MOST_RAD} rad assumed", chain[k].name));
        }
    }
    Ok(LegFound { joints: chain.map(|joint| joint.name.clone()), toe: toe.to_owned(), min_rad, max_rad })
}
