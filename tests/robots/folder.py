"""A robot's folder, as config/robots/NAME is one, from a URDF of the example-robot-data wheel: nothing of it is kept in this
project.

    folder.py ROBOT SHARE OUT

ROBOT is go2 or solo12, SHARE the wheel's robots folder. What a URDF does not say is here: postures, gains, and what the drives
give (Unitree's and the Open Dynamic Robot Initiative's published numbers).
"""
import math
import os
import re
import sys
import xml.etree.ElementTree as ET

LEGS = ("front_left", "rear_left", "front_right", "rear_right")
ROBOTS = {
    "go2": dict(
        urdf="go2_description/urdf/go2.urdf",
        joints=[f"{leg}_{joint}_joint" for leg in ("FL", "RL", "FR", "RR") for joint in ("hip", "thigh", "calf")],
        toes=[f"{leg}_foot" for leg in ("FL", "RL", "FR", "RR")],
        toe_radius=0.022, height=0.30, knee=-1, sit=[0.0, 1.3, -2.65],
        low=[-1.0, -1.5, -2.7], high=[1.0, 3.4, -0.84], plan=[20.0, 20.0, 30.0], drive=[23.7, 23.7, 45.43],
        velocity=[30.1, 30.1, 15.7], kp=[80.0, 80.0, 100.0], kd=[2.0, 2.0, 2.0]),
    "solo12": dict(
        urdf="solo_description/robots/solo12.urdf",
        joints=[f"{leg}_{joint}" for leg in ("FL", "HL", "FR", "HR") for joint in ("HAA", "HFE", "KFE")],
        toes=[f"{leg}_FOOT" for leg in ("FL", "HL", "FR", "HR")],
        toe_radius=0.017, height=0.24, knee=-1, sit=[0.0, 1.2, -2.5],
        low=[-0.9, -1.45, -2.8], high=[0.9, 1.45, 2.8], plan=[2.2, 2.2, 2.2], drive=[2.7, 2.7, 2.7],
        velocity=[30.0, 30.0, 30.0], kp=[10.0, 10.0, 10.0], kd=[0.2, 0.2, 0.2]),
}


def product(a, b):
    return [[sum(a[i][k] * b[k][j] for k in range(4)) for j in range(4)] for i in range(4)]


def placement(xyz, rpy):
    (cr, sr), (cp, sp), (cy, sy) = [(math.cos(a), math.sin(a)) for a in rpy]
    r = [[cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
         [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr], [-sp, cp * sr, cp * cr]]
    return [[*r[i], xyz[i]] for i in range(3)] + [[0, 0, 0, 1]]


def numbers(element, name):
    text = element.get(name) if element is not None else None
    return [float(x) for x in text.split()] if text else [0.0, 0.0, 0.0]


def toe_of(tree, toe, angles):
    """Where a link is in the root link, for joint angles by name (axes along x or y)."""
    above = {j.find("child").get("link"): j for j in tree.findall("joint")}
    pose = placement([0, 0, 0], [0, 0, 0])
    link = toe
    while link in above:
        joint = above[link]
        own = placement(numbers(joint.find("origin"), "xyz"), numbers(joint.find("origin"), "rpy"))
        if joint.get("name") in angles:
            axis = numbers(joint.find("axis"), "xyz")
            own = product(own, placement([0, 0, 0], [a * angles[joint.get("name")] for a in axis]))
        pose = product(own, pose)
        link = joint.find("parent").get("link")
    return [pose[i][3] for i in range(3)]


def main():
    name, share, out = sys.argv[1:]
    r = ROBOTS[name]
    with open(os.path.join(share, r["urdf"])) as file:
        # Shapes are of no concern here, and some name files outside the folder.
        urdf = re.sub(r"<(visual|collision)\b.*?</\1>", "", file.read(), flags=re.DOTALL)
    tree = ET.fromstring(urdf)
    # But the toes: a ball each, which is what the simulation stands on.
    for toe in r["toes"]:
        link = next(link for link in tree.findall("link") if link.get("name") == toe)
        shape = ET.SubElement(ET.SubElement(link, "collision"), "geometry")
        ET.SubElement(shape, "sphere", radius=str(r["toe_radius"]))
    joints, first = r["joints"], r["joints"][:3]
    # Standing: the toe below the hip, by bisection on the bend; equal links make the hip pitch half the knee's.
    hip = toe_of(tree, next(j for j in tree.findall("joint") if j.get("name") == first[1]).find("child").get("link"), {})
    low, high = 0.05, 1.4
    for _ in range(60):
        bend = 0.5 * (low + high)
        toe = toe_of(tree, r["toes"][0], dict(zip(first, (0.0, bend, 2 * r["knee"] * bend))))
        low, high = (bend, high) if hip[2] - toe[2] > r["height"] else (low, bend)
    stand = [0.0, bend, 2 * r["knee"] * bend]
    legs = "".join(f"""
[[legs]]
name = "{leg}"
joints = {joints[3 * i:3 * i + 3]!r}
toe_link = "{r['toes'][i]}"
position_min_rad = {r['low']}
position_max_rad = {r['high']}
stand_rad = {stand}
sit_rad = {r['sit']}
""".replace("'", '"') for i, leg in enumerate(LEGS))
    os.makedirs(out, exist_ok=True)
    with open(os.path.join(out, name + ".urdf"), "w") as file:
        file.write(ET.tostring(tree, encoding="unicode"))
    with open(os.path.join(out, "robot.toml"), "w") as file:
        file.write(f"""format = "tandem-robot"
version = 1
name = "{name}"
urdf = "{name}.urdf"
toe_radius_m = {r['toe_radius']}
[mirror]
leg = [2, 3, 0, 1]
joint_sign = [-1.0, 1.0, 1.0]
tolerance = 0.05
[nominal]
height_m = {r['height']}
half_width_m = {abs(toe[1]):.4f}
[gains]
kp_nm_per_rad = {r['kp']}
kd_nm_s_per_rad = {r['kd']}
[limits]
plan_torque_nm = {r['plan']}
drive_torque_nm = {r['drive']}
velocity_rad_s = {r['velocity']}
{legs}""")


main()
