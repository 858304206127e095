#!/usr/bin/env python3
"""The program of a stride (docs/mathematics.md, 7) written a second time, on CasADi and IPOPT, and its optimum beside
the planner's.

    program.py STRIDES.json [TOLERANCE]

STRIDES.json is what the example `export_strides` prints: requests, where their solves start (the cost stays near those
joints) and what the planner found. The robot is read from its URDF here; its dynamics are Kane's equations by automatic
differentiation, link by link, where the planner's are recursive.
"""

import json
import math
import sys
import tomllib
import xml.etree.ElementTree as xml
from pathlib import Path

import casadi as ca
import numpy as np

ROBOT = Path(__file__).resolve().parents[2] / "config/robots/vision60"
GRAVITY = 9.81
POINTS = 11
JOINTS = 12
DOF = 18
# (stance legs, swing legs, the joint whose output row the toes' distance makes redundant) of both steps; legs are front
# left, rear left, front right, rear right.
STEPS = [([1, 2], [0, 3], 6), ([3, 0], [2, 1], 0)]


def numbers(text):
    return np.array([float(word) for word in text.split()])


def rotation(axis, angle):
    """Rodrigues' formula for a unit axis."""
    k = ca.skew(ca.DM(axis))
    return ca.DM.eye(3) + ca.sin(angle) * k + (1 - ca.cos(angle)) * (k @ k)


class Robot:
    """Links, joints and toes of a URDF, with the description's limits."""

    def __init__(self, folder):
        self.about = tomllib.loads((folder / "robot.toml").read_text())
        tree = xml.parse(folder / self.about["urdf"]).getroot()
        self.links = {link.get("name"): link.find("inertial") for link in tree.findall("link")}
        self.joints = {joint.get("name"): joint for joint in tree.findall("joint")}
        children = {joint.find("child").get("link") for joint in self.joints.values()}
        (self.root,) = set(self.links) - children
        self.order = [name for leg in self.about["legs"] for name in leg["joints"]]
        self.toes = [leg["toe_link"] for leg in self.about["legs"]]
        self.low = np.concatenate([leg["position_min_rad"] for leg in self.about["legs"]])
        self.high = np.concatenate([leg["position_max_rad"] for leg in self.about["legs"]])
        self.mass = sum(float(i.find("mass").get("value")) for i in self.links.values() if i is not None)

    def frames(self, q, v):
        """{link: (rotation, origin, angular velocity)} in the world."""
        x, y, z = np.eye(3)
        yaw = rotation(z, q[5])
        pitched = yaw @ rotation(y, q[4])
        spin = ca.DM(z) * v[5] + yaw @ ca.DM(y) * v[4] + pitched @ ca.DM(x) * v[3]
        frames = {self.root: (pitched @ rotation(x, q[3]), q[:3], spin)}
        pending = list(self.joints.values())
        while pending:
            joint = pending.pop(0)
            parent, child = joint.find("parent").get("link"), joint.find("child").get("link")
            if parent not in frames:
                pending.append(joint)
                continue
            turn, place, spin = frames[parent]
            origin = joint.find("origin")
            place = place + turn @ ca.DM(numbers(origin.get("xyz", "0 0 0")))
            roll, pitch, heading = numbers(origin.get("rpy", "0 0 0"))
            turn = turn @ rotation(z, heading) @ rotation(y, pitch) @ rotation(x, roll)
            if joint.get("type") != "fixed":
                at = 6 + self.order.index(joint.get("name"))
                axis = numbers(joint.find("axis").get("xyz"))
                spin = spin + turn @ ca.DM(axis) * v[at]
                turn = turn @ rotation(axis, q[at])
            frames[child] = (turn, place, spin)
        return frames

    def functions(self):
        """(q, q̇, q̈, forces on the four toes) to (generalised forces, toes' positions, velocities, accelerations)."""
        q, v, a, force = (ca.SX.sym(name, size) for name, size in [("q", DOF), ("v", DOF), ("a", DOF), ("f", JOINTS)])
        state, rate = ca.vertcat(q, v), ca.vertcat(v, a)
        frames = self.frames(q, v)
        tau = ca.SX.zeros(DOF)
        for name, inertial in self.links.items():
            if inertial is None:
                continue
            turn, place, spin = frames[name]
            origin = inertial.find("origin")
            assert origin is None or not numbers(origin.get("rpy", "0 0 0")).any(), f"{name}: a turned inertia"
            centre = numbers(origin.get("xyz", "0 0 0")) if origin is not None else np.zeros(3)
            mass, about = float(inertial.find("mass").get("value")), inertial.find("inertia")
            xx, xy, xz, yy, yz, zz = (float(about.get(key, "0")) for key in ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"])
            inertia = turn @ ca.DM([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
            com = place + turn @ ca.DM(centre)
            speed = ca.jtimes(com, q, v)
            pushed = mass * (ca.jtimes(speed, state, rate) + ca.DM([0, 0, GRAVITY]))
            turned = inertia @ ca.jtimes(spin, state, rate) + ca.cross(spin, inertia @ spin)
            tau += ca.jtimes(com, q, pushed, True) + ca.jtimes(spin, v, turned, True)
        toes = ca.vertcat(*[frames[toe][1] for toe in self.toes])
        speed = ca.jtimes(toes, q, v)
        tau -= ca.jtimes(toes, q, force, True)
        return ca.Function("robot", [q, v, a, force], [tau, toes, speed, ca.jtimes(speed, state, rate)], {"cse": True})

    def toe_distance(self, half_width):
        """Between toes 1 and 2 below their hips."""
        zero = ca.DM.zeros(DOF)
        frames = self.frames(zero, zero)
        hip = [frames[self.joints[self.order[3 * leg]].find("child").get("link")][1] for leg in (1, 2)]
        return math.hypot(float(hip[1][0] - hip[0][0]), 2 * half_width)


def bernstein(phase, derivative):
    """The basis of degree 5 or its derivative by the phase."""
    if derivative == 0:
        return np.array([math.comb(5, k) * phase**k * (1 - phase) ** (5 - k) for k in range(6)])
    # The derivative of a polynomial is one of a degree less, through the differences of its coefficients.
    degree = 5
    rows = np.eye(6)
    for _ in range(derivative):
        rows = degree * (rows[1:] - rows[:-1])
        degree -= 1
    return np.array([math.comb(degree, k) * phase**k * (1 - phase) ** (degree - k) for k in range(degree + 1)]) @ rows


def motion(velocity, t):
    """exp(t (v_x, v_y, ω)): rotation, displacement; the latter by the chord of the arc."""
    turn = velocity[2] * t
    c, s = ca.cos(turn), ca.sin(turn)
    r = ca.vertcat(ca.horzcat(c, -s), ca.horzcat(s, c))
    if velocity[2] == 0:
        return r, ca.vertcat(velocity[0] * t, velocity[1] * t)
    centre = ca.vertcat(-velocity[1], velocity[0]) / velocity[2]
    return r, centre - r @ centre


class Program:
    """Unknowns, rows and cost, gathered one after the other."""

    def __init__(self):
        self.x, self.start, self.low, self.high, self.rows, self.least, self.most, self.cost = [], [], [], [], [], [], [], 0

    def unknown(self, name, start, low, high):
        size = len(start)
        self.x.append(ca.MX.sym(name, size))
        self.start.append(np.asarray(start, float))
        self.low.append(np.broadcast_to(np.asarray(low, float), size))
        self.high.append(np.broadcast_to(np.asarray(high, float), size))
        return self.x[-1]

    def row(self, value, least=0.0, most=0.0):
        self.rows.append(value)
        self.least.append(np.full(value.numel(), least))
        self.most.append(np.full(value.numel(), most))

    def solve(self):
        problem = {"x": ca.vertcat(*self.x), "f": self.cost, "g": ca.vertcat(*self.rows)}
        options = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-9, "max_iter": 300}}
        solver = ca.nlpsol("stride", "ipopt", problem, options)
        join = np.concatenate
        found = solver(x0=join(self.start), lbx=join(self.low), ubx=join(self.high), lbg=join(self.least), ubg=join(self.most))
        stats = solver.stats()
        if not stats["success"]:
            sys.exit(f"IPOPT ended with {stats['return_status']} after {stats['iter_count']} iterations")
        return float(found["f"]), found["x"], stats["iter_count"]


def height(clearance, point):
    """Least and most of a swing toe at a point."""
    phase = point / (POINTS - 1)
    if point in (0, POINTS - 1):
        return -0.05, 0.05
    if phase == 0.5:
        return clearance - 0.005, clearance + 0.005
    return (1.2 * clearance * phase * (1 - phase) if 0.2 <= phase <= 0.8 else 0.0), clearance + 0.01


class Stride:
    def __init__(self, robot, functions, stride):
        self.robot, self.functions, self.asked, self.begun = robot, functions, stride["request"], stride["start"]
        self.velocity = [self.asked.get(key, 0.0) for key in ("speed_m_s", "lateral_speed_m_s", "yaw_rate_rad_s")]
        self.nominal = self.asked["step_duration_s"]
        self.p = Program()
        self.t = self.p.unknown("T", [self.nominal], 0.99 * self.nominal, 1.01 * self.nominal)
        self.steps = [self.step(number) for number in range(2)]
        self.close()

    def point(self, step, index):
        """Unknowns of a point and what the robot does there."""
        begun, p, robot = self.begun[step][index], self.p, self.robot
        time = (step + index / (POINTS - 1)) * self.nominal
        turn, ahead = (ca.DM(value).full() for value in motion(self.velocity, time))
        reach = (0.5 + abs(self.velocity[0] * self.nominal)) * (step + 1)
        middle = np.array([0, ahead[1, 0], self.asked["height_m"], 0, 0, self.velocity[2] * time])
        room = np.array([reach, 0.3, 0.01, 0.3, 0.3, 0.3])
        rates = np.concatenate([[4.0] * 3, [6.0] * 3, np.tile(robot.about["limits"]["velocity_rad_s"], 4)])
        accelerations = np.concatenate([[100.0] * 3, [300.0] * 3, [3000.0] * JOINTS])
        torques = np.tile(self.asked["torque_limit_nm"], 4)
        # Joints stay inside their range by what polynomials may depart from them: 0.3 of what the law answers 2 % of
        # the torque with.
        margin = 0.3 * min(0.02 * np.array(self.asked["torque_limit_nm"]) / robot.about["gains"]["kp_nm_per_rad"])
        q = p.unknown("q", begun["q"], np.r_[middle - room, robot.low + margin], np.r_[middle + room, robot.high - margin])
        v = p.unknown("v", begun["v"], -rates, rates)
        a = p.unknown("a", begun["a"], -accelerations, accelerations)
        u = p.unknown("u", begun["torque_nm"], -torques, torques)
        stance, swing, _ = STEPS[step]
        least = 30.0 / 38.0 * robot.mass
        force = p.unknown("f", np.concatenate([begun["ground_force_n"][leg] for leg in stance]), [-1e3, -1e3, least] * 2, [1e3, 1e3, 3e3] * 2)
        forces = [ca.MX.zeros(3)] * 4
        for k, leg in enumerate(stance):
            forces[leg] = force[3 * k : 3 * k + 3]
        tau, place, speed, acceleration = self.functions(q, v, a, ca.vertcat(*forces))
        p.row(tau - ca.vertcat(ca.MX.zeros(6), u))
        p.row(ca.vertcat(*[acceleration[3 * leg : 3 * leg + 3] for leg in stance]))
        for leg in stance:
            along = ca.DM(turn).T @ forces[leg][:2]
            face = self.asked["friction"] / math.sqrt(2) * forces[leg][2]
            p.row(ca.vertcat(face - along, face + along), 0.0, math.inf)
        p.row(ca.vertcat(*[place[3 * leg + 2] for leg in swing]), *height(self.asked["clearance_m"], index))
        self.add_cost(q, v, a, u, np.r_[(turn @ self.velocity[:2]), 0, 0, 0, self.velocity[2]], begun)
        return {"q": q, "v": v, "a": a, "place": place, "speed": speed}

    def add_cost(self, q, v, a, u, wanted, begun):
        front = ca.vertcat(a[:9], a[12:15])
        self.p.cost += ca.sumsqr(v[:6] - ca.DM(wanted)) + 1e-7 * ca.sumsqr(front) + 1e-6 * ca.sumsqr(u) + ca.sumsqr(q[3:5])
        self.p.cost += 1e-3 * ca.sumsqr(q[6:] - ca.DM(begun["q"][6:])) + 0.1 * ca.sumsqr(v[6:] - ca.DM(begun["v"][6:]))

    def step(self, number):
        """Points of a step, on polynomials and joined by Hermite–Simpson's rule."""
        p, t, (stance, _, redundant) = self.p, self.t, STEPS[number]
        spare = 0.3
        begun = np.array([point["q"][6:] for point in self.begun[number]])
        basis = np.array([bernstein(index / (POINTS - 1), 0) for index in range(POINTS)])
        guess = np.linalg.lstsq(basis, begun, rcond=None)[0]
        rows = [p.unknown("alpha", guess[k], self.robot.low - spare, self.robot.high + spare) for k in range(6)]
        alpha = ca.horzcat(*rows)
        points = [self.point(number, index) for index in range(POINTS)]
        for index, point in enumerate(points):
            wanted = alpha @ ca.DM(bernstein(index / (POINTS - 1), 2))
            kept = [j for j in range(JOINTS) if j != redundant or index in (2, 4, 6, 8)]
            p.row((t**2 * point["a"][6:] - wanted)[kept])
        first = points[0]
        p.row(first["q"][6:] - alpha @ ca.DM(bernstein(0.0, 0)))
        p.row(t * first["v"][6:] - alpha @ ca.DM(bernstein(0.0, 1)))
        p.row(ca.vertcat(*[first["place"][3 * leg + 2] for leg in stance]))
        one, other = (first["place"][3 * leg : 3 * leg + 3] for leg in stance)
        distance = self.robot.toe_distance(self.asked["half_width_m"])
        p.row(ca.sumsqr(one - other), (distance - 0.005) ** 2, (distance + 0.005) ** 2)
        h = 2 * t / (POINTS - 1)
        for k in range(0, POINTS - 1, 2):
            a, b, c = points[k : k + 3]
            for value, rate in (("q", "v"), ("v", "a")):
                p.row(b[value] - (a[value] + c[value]) / 2 - h / 8 * (a[rate] - c[rate]))
                p.row(c[value] - a[value] - h / 6 * (a[rate] + 4 * b[rate] + c[rate]))
        return points

    def close(self):
        """Steps that join, a stride that repeats after its motion, toes that land at rest."""
        p, (first, second) = self.p, self.steps
        p.row(first[-1]["q"] - second[0]["q"])
        p.row(first[-1]["v"] - second[0]["v"])
        turn, ahead = motion(self.velocity, 2 * self.t)
        start, end, yaw = first[0], second[-1], self.velocity[2] * self.t
        p.row(end["q"][:2] - turn @ start["q"][:2] - ahead)
        p.row(end["v"][:2] - turn @ start["v"][:2])
        p.row(end["q"][2:5] - start["q"][2:5])
        p.row(end["q"][5] - start["q"][5] - 2 * yaw)
        p.row(end["q"][6:] - start["q"][6:])
        p.row(end["v"][2:] - start["v"][2:])
        turn, ahead = motion(self.velocity, self.t)
        p.row(turn.T @ (second[0]["q"][:2] - ahead) + start["q"][:2])
        p.row(second[0]["q"][5] - yaw + start["q"][5])
        for points, (_, swing, _) in zip(self.steps, STEPS):
            p.row(ca.vertcat(*[points[-1]["speed"][3 * leg : 3 * leg + 3] for leg in swing]))

    def joints(self, x):
        """Of every point, from the solution."""
        every = [point["q"][6:] for step in self.steps for point in step]
        return ca.Function("joints", [ca.vertcat(*self.p.x)], [ca.horzcat(*every)])(x).full().T


def main():
    strides, tolerance = json.loads(Path(sys.argv[1]).read_text()), float(sys.argv[2]) if len(sys.argv) > 2 else 1e-4
    robot = Robot(ROBOT)
    functions, worst = robot.functions(), 0.0
    for stride in strides:
        program = Stride(robot, functions, stride)
        cost, x, iterations = program.p.solve()
        planned = np.array([point["q"][6:] for step in stride["planned"] for point in step])
        apart = abs(program.joints(x) - planned).max()
        off = abs(cost / stride["cost"] - 1)
        worst = max(worst, off)
        name = "_".join(f"{value:g}" for value in program.velocity)
        print(f"stride_{name} = planner {stride['cost']:.8f}, IPOPT {cost:.8f} in {iterations} iterations, off by {off:.1e}, joints {apart:.1e} rad")
    print(f"strides_largest_difference = {worst:.1e}")
    if not worst <= tolerance:
        sys.exit(f"strides: costs differ by up to {worst:.1e}, expected {tolerance:.1e}")


if __name__ == "__main__":
    main()
