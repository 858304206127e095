"""Subscriptions of rclpy's default quality of service (reliable, volatile, depth 10) to everything that the nodes publish: they receive it,
and neither their coming and going nor one that has stalled stops anybody."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest
from conftest import DOMAIN, ROOT, wait_until
from test_walk import Robot

JOINS = 20
STALLED_S = 15

# A process of its own, as `ros2 topic echo` is one: subscribes to all topics, and prints for each how long after its
# discovery the first message came. All types are loaded first: a library is a part of a second, in which nothing would
# be received.
SUBSCRIBER = """
import importlib, json, sys, time
import rclpy
from rclpy.type_support import check_for_type_support
types, seconds, stay = json.loads(sys.argv[1]), float(sys.argv[2]), len(sys.argv) > 3
classes = {}
for name, type_ in types.items():
    package, _, kind = type_.split("/")
    classes[name] = getattr(importlib.import_module(package + ".msg"), kind)
    check_for_type_support(classes[name])
rclpy.init()
node = rclpy.create_node("joining")
seen, first, count = {}, {}, {}
def received(name):
    def receive(message):
        first.setdefault(name, time.monotonic())
        count[name] = count.get(name, 0) + 1
    return receive
begun = time.monotonic()
def over():
    return not stay and (time.monotonic() > begun + seconds or len(first) == len(types))
while not over():
    if len(seen) < len(types):
        known = dict(node.get_topic_names_and_types())
        for name in types:
            if name not in seen and name in known and node.count_publishers(name):
                assert known[name] == [types[name]], (name, known[name])
                node.create_subscription(classes[name], name, received(name), 10)
                seen[name] = time.monotonic()
                break
        if stay and len(seen) == len(types):
            print("ready", flush=True)
    rclpy.spin_once(node, timeout_sec=0.01)
late = {name: first[name] - at if name in first else None for name, at in seen.items()}
print(json.dumps({"missing": [name for name in types if name not in seen], "late_s": late, "count": count}), flush=True)
"""
# Without /tf: tf2_msgs is in no wheel. It is offered as the others are.
TYPES = {
    "joint_states": "sensor_msgs/msg/JointState",
    "joint_command": "tandem_msgs/msg/JointCommand",
    "controller_state": "tandem_msgs/msg/ControllerState",
    "odom": "nav_msgs/msg/Odometry",
    "imu": "sensor_msgs/msg/Imu",
    "real_time_factor": "std_msgs/msg/Float64",
    "diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "clock": "rosgraph_msgs/msg/Clock",
    **{f"ground_force/{leg}": "geometry_msgs/msg/WrenchStamped" for leg in ("front_left", "rear_left", "front_right", "rear_right")},
}
# Longest time between two messages, s of the wall clock: what comes with a step, and what comes once a second.
PERIOD_S = {"diagnostics": 1.0, "real_time_factor": 1.0}


def subscriber(*arguments):
    command = [sys.executable, "-c", SUBSCRIBER, *map(str, arguments)]
    environment = {**os.environ, "ROS_DOMAIN_ID": str(DOMAIN)}
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT, env=environment)


def topics(namespace):
    """The type of every topic."""
    absolute = {"diagnostics": "/diagnostics", "clock": f"{namespace}/clock"}
    return {absolute.get(name, f"{namespace}/{name}"): type_ for name, type_ in TYPES.items()}


def period_s(topic):
    return PERIOD_S.get(topic.rpartition("/")[2], 0.1)


def arm(robot):
    robot.pause(False)
    robot.wait(lambda: robot.time() > 1, 30, "simulated time")


def test_default_subscriptions_come_and_go_in_lockstep(processes, ros):
    robot = Robot(processes, ros, "/joined", planner=False)
    try:
        arm(robot)
        # Longer than the middleware's former window of 8,192 samples: a reader that joins then has acknowledged nothing
        # of it.
        robot.wait(lambda: robot.time() > 9, 60, "9 s of simulated time")
        names = topics("/joined")
        latest = dict.fromkeys(names, 0.0)
        for join in range(JOINS):
            before = robot.time()
            process = subscriber(json.dumps(names), 20)
            figures = json.loads(process.communicate(timeout=60)[0])
            robot.check()
            assert not figures["missing"], f"join {join}: {figures}"
            for name, late in figures["late_s"].items():
                assert late is not None, f"join {join}: nothing on {name}: {figures}"
                latest[name] = max(latest[name], late)
            assert robot.time() > before, f"join {join}: the simulation stands at {before} s"
        print(f"{JOINS} joins; latest first message after discovery, s: { {name: round(late, 3) for name, late in latest.items()} }")
        assert all(late < 1 + period_s(name) for name, late in latest.items()), latest
    finally:
        robot.close()


@pytest.mark.parametrize("mode", ["realtime", "lockstep"])
def test_a_stalled_reliable_subscriber_stops_nobody(processes, ros, mode):
    robot = Robot(processes, ros, f"/stalled_{mode}", planner=False, mode=mode)
    process = None
    try:
        arm(robot)
        process = subscriber(json.dumps(topics(robot.namespace)), 0, "stay")
        assert process.stdout.readline() == "ready\n"
        time.sleep(1)
        process.send_signal(signal.SIGSTOP)
        began, from_s, received = time.monotonic(), robot.time(), len(robot.odometry)
        longest, last = 0.0, (began, from_s)
        while time.monotonic() < began + STALLED_S:
            robot.check()
            now = (time.monotonic(), robot.time())
            if now[1] > last[1]:
                longest, last = max(longest, now[0] - last[0]), now
            time.sleep(0.01)
        walked = robot.time() - from_s
        print(f"{mode}: {walked:.1f} s simulated in {STALLED_S} s, {len(robot.odometry) - received} odometry, longest standstill {longest:.3f} s")
        assert walked > 0.3 * STALLED_S and longest < 2
        # Once it goes on, the simulation does as well, and what it published is received.
        process.send_signal(signal.SIGCONT)
        before = robot.time()
        robot.wait(lambda: robot.time() > before + 1, 30, "simulated time after the stalled one goes on")
    finally:
        if process is not None:
            process.kill()
            process.wait()
        robot.close()


@pytest.mark.parametrize("mode", ["realtime", "lockstep"])
def test_a_paused_simulation_tells_the_standing_time(processes, ros, mode):
    from rosgraph_msgs.msg import Clock

    robot = Robot(processes, ros, f"/paused_{mode}", planner=False, mode=mode)
    try:
        clocks = []
        robot.client.node.create_subscription(Clock, f"{robot.namespace}/clock", lambda message: clocks.append(message.clock), 10)
        robot.wait(lambda: len(clocks) > 5, 30, "the clock of a paused simulation")
        assert len({(clock.sec, clock.nanosec) for clock in clocks}) == 1, "time stands still"
    finally:
        robot.close()
