"""Dynamics of quadrupeds computed by Pinocchio, for our own to be compared with.

    golden.py ROBOT STATES OUT.json [--folder DIR]

ROBOT is vision60 (this project's own) or one of the robots of the example-robot-data wheel listed below. Numbers are in
this project's coordinates: x, y, z, roll, pitch, yaw, then leg * 3 + joint. Pinocchio gets the same chain of six joints
as its base, written into the URDF. With --folder the robot's folder, as config/robots/NAME is one, is written too: its
URDF is copied there from the wheel, never into the project.
"""
import argparse
import json
import os
import re
import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin

HERE = os.path.dirname(os.path.abspath(__file__))
VISION60 = os.path.join(HERE, "..", "..", "config", "robots", "vision60", "vision60.urdf")
DATA = os.path.join(os.path.dirname(pin.__file__), *[os.pardir] * 4, "share", "example-robot-data", "robots")
UNITREE = ([f"{leg}_{joint}_joint" for leg in ("FL", "RL", "FR", "RR") for joint in ("hip", "thigh", "calf")],
           [f"{leg}_foot" for leg in ("FL", "RL", "FR", "RR")])
ANYMAL = ([f"{leg}_{joint}" for leg in ("LF", "LH", "RF", "RH") for joint in ("HAA", "HFE", "KFE")],
          [f"{leg}_FOOT" for leg in ("LF", "LH", "RF", "RH")])
SOLO = ([f"{leg}_{joint}" for leg in ("FL", "HL", "FR", "HR") for joint in ("HAA", "HFE", "KFE")],
        [f"{leg}_FOOT" for leg in ("FL", "HL", "FR", "HR")])
# URDF, joints and toe links in this project's order of legs.
ROBOTS = {
    "vision60": (VISION60, [f"{leg}_{joint}" for leg in ("front_left", "rear_left", "front_right", "rear_right")
                            for joint in ("hip_roll", "hip_pitch", "knee")],
                 [f"{leg}_toe" for leg in ("front_left", "rear_left", "front_right", "rear_right")]),
    "go2": ("go2_description/urdf/go2.urdf", *UNITREE),
    "a1": ("a1_description/urdf/a1.urdf", *UNITREE),
    "solo12": ("solo_description/robots/solo12.urdf", *SOLO),
    "hyq": ("hyq_description/robots/hyq_no_sensors.urdf",
            [f"{leg}_{joint}_joint" for leg in ("lf", "lh", "rf", "rh") for joint in ("haa", "hfe", "kfe")],
            [f"{leg}_foot" for leg in ("lf", "lh", "rf", "rh")]),
    "anymal_b": ("anymal_b_simple_description/robots/anymal.urdf", *ANYMAL),
    "anymal_c": ("anymal_c_simple_description/urdf/anymal.urdf", *ANYMAL),
}


def with_base(urdf):
    """The URDF with x, y, z, yaw, pitch, roll joints above its root link."""
    tree = ET.fromstring(urdf)
    children = {joint.find("child").get("link") for joint in tree.findall("joint")}
    (root,) = [link.get("name") for link in tree.findall("link") if link.get("name") not in children]
    parent = "the_world"
    ET.SubElement(tree, "link", name=parent)
    chain = [("x", "prismatic", "1 0 0"), ("y", "prismatic", "0 1 0"), ("z", "prismatic", "0 0 1"),
             ("yaw", "revolute", "0 0 1"), ("pitch", "revolute", "0 1 0"), ("roll", "revolute", "1 0 0")]
    for name, kind, axis in chain:
        child = root if name == "roll" else "base_after_" + name
        if child != root:
            ET.SubElement(tree, "link", name=child)
        joint = ET.SubElement(tree, "joint", name="base_" + name, type=kind)
        ET.SubElement(joint, "parent", link=parent)
        ET.SubElement(joint, "child", link=child)
        ET.SubElement(joint, "axis", xyz=axis)
        ET.SubElement(joint, "limit", lower="-1e9", upper="1e9", effort="1e9", velocity="1e9")
        parent = child
    return ET.tostring(tree, encoding="unicode")


def main():
    arguments = argparse.ArgumentParser()
    arguments.add_argument("robot", choices=ROBOTS)
    arguments.add_argument("states", type=int)
    arguments.add_argument("out")
    arguments.add_argument("--urdf", help="where the robot's URDF is written to, without shapes")
    arguments = arguments.parse_args()
    path, joints, toes = ROBOTS[arguments.robot]
    urdf = open(os.path.join(DATA, path)).read()
    model = pin.buildModelFromXML(with_base(urdf))
    data = model.createData()
    names = ["base_" + n for n in ("x", "y", "z", "roll", "pitch", "yaw")] + joints
    assert model.nv == 18, f"{arguments.robot} has {model.nv} coordinates, expected 18"
    order = np.array([model.joints[model.getJointId(name)].idx_v for name in names])

    def theirs(x):
        y = np.zeros(18)
        y[order] = x
        return y

    ours = lambda x: x[order]
    square = lambda m: m[np.ix_(order, order)]
    symmetric = lambda m: np.triu(m) + np.triu(m, 1).T
    generator = np.random.default_rng(60)
    states = []
    for _ in range(arguments.states):
        q, v, a = generator.uniform(-1, 1, (3, 18)) * np.array([[1.2], [4.0], [20.0]])
        qp, vp, ap = pin.integrate(model, pin.neutral(model), theirs(q)), theirs(v), theirs(a)
        mass = symmetric(pin.crba(model, data, qp))
        bias = pin.nonLinearEffects(model, data, qp, vp).copy()
        tau = pin.rnea(model, data, qp, vp, ap).copy()
        dq, dv, _ = (m.copy() for m in pin.computeRNEADerivatives(model, data, qp, vp, ap))
        aba = pin.aba(model, data, qp, vp, ap).copy()  # a as torque
        pin.forwardKinematics(model, data, qp, vp, ap)
        pin.computeJointJacobians(model, data, qp)
        pin.updateFramePlacements(model, data)
        points = []
        for toe in toes:
            frame = model.getFrameId(toe)
            local = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
            jacobian = pin.getFrameJacobian(model, data, frame, local)[:3][:, order]
            points.append({
                "position": data.oMf[frame].translation.tolist(),
                "velocity": pin.getFrameVelocity(model, data, frame, local).linear.tolist(),
                "acceleration": pin.getFrameClassicalAcceleration(model, data, frame, local).linear.tolist(),
                "jacobian": jacobian.T.ravel().tolist(),  # column-major
            })
        # Plastic impact of toes 0 and 3.
        full = np.vstack([pin.getFrameJacobian(model, data, model.getFrameId(toes[leg]), local)[:3] for leg in (0, 3)])
        after = pin.impulseDynamics(model, data, qp, vp, full, 0.0, 0.0).copy()
        states.append({
            "q": q.tolist(), "v": v.tolist(), "a": a.tolist(),
            "mass": square(mass).T.ravel().tolist(), "bias": ours(bias).tolist(), "tau": ours(tau).tolist(),
            "dtau_dq": square(dq).T.ravel().tolist(), "dtau_dv": square(dv).T.ravel().tolist(),
            "forward": ours(aba).tolist(), "toes": points, "impact": ours(after).tolist(),
        })
    golden = {"robot": arguments.robot, "made_by": f"tests/pinocchio/golden.py, pin {pin.__version__}",
              "joints": joints, "toes": toes, "states": states}
    with open(arguments.out, "w") as out:
        json.dump(golden, out, indent=None, separators=(",", ":"))
        out.write("\n")
    if arguments.urdf:
        with open(arguments.urdf, "w") as out:
            out.write(without_shapes(urdf))


def without_shapes(urdf):
    """Shapes are of no concern here: some name files elsewhere, and a ball would move the toe's frame to its centre."""
    return re.sub(r"<(visual|collision)\b.*?</\1>", "", urdf, flags=re.DOTALL)


main()
