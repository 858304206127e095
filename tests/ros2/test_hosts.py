"""Two hosts: network namespaces joined by a virtual cable. The planner is on one, the robot with its controller on the other."""

import json
import math
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time

import pytest
from conftest import ROOT, TARGET, Process, wait_until

PLANNER, ROBOT = "tandem_planner_host", "tandem_robot_host"
MODE = os.environ.get("TANDEM_HOSTS_MODE", "lockstep")


def ip(*arguments, check=True):
    return subprocess.run(["ip", *arguments], check=check, capture_output=True, text=True)


@pytest.fixture
def hosts():
    tried = ip("netns", "add", PLANNER, check=False)
    if tried.returncode:
        pytest.skip(f"network namespaces are not permitted here: {tried.stderr.strip()}")
    try:
        ip("netns", "add", ROBOT)
        ip("link", "add", "to_robot", "netns", PLANNER, "type", "veth", "peer", "name", "to_planner", "netns", ROBOT)
        for host, cable, address in ((PLANNER, "to_robot", "10.77.0.1/24"), (ROBOT, "to_planner", "10.77.0.2/24")):
            ip("-n", host, "addr", "add", address, "dev", cable)
            ip("-n", host, "link", "set", "lo", "up")
            ip("-n", host, "link", "set", cable, "up")
            ip("-n", host, "route", "add", "239.255.0.0/16", "dev", cable)
        yield
    finally:
        for host in (PLANNER, ROBOT):
            ip("netns", "del", host, check=False)


def cable(state):
    ip("-n", PLANNER, "link", "set", "to_robot", state)


class Host:
    """Programs on one host, and an rclpy node there that does what it is asked."""

    def __init__(self, name, folder):
        self.name, self.folder, self.started = name, folder, []
        environment = {**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
        self.errors = open(folder / f"{name}.log", "wb")
        self.helper = subprocess.Popen(
            ["ip", "netns", "exec", name, sys.executable, ROOT / "tests/ros2/at_host.py", name],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self.errors, text=True, env=environment, cwd=ROOT,
        )  # fmt: skip

    def start(self, program, *arguments):
        command = ["env", "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET", "ip", "netns", "exec", self.name, str(TARGET / program)]
        log = self.folder / f"{program}-{len(self.started)}.log"
        process = Process("/usr/bin/env", [*command[1:], *arguments], log)
        self.started.append(process)
        return process

    def ask(self, **request):
        self.helper.stdin.write(json.dumps(request) + "\n")
        self.helper.stdin.flush()
        line = self.helper.stdout.readline()
        assert line, f"the helper on {self.name} ended: {(self.folder / f'{self.name}.log').read_text()}"
        return json.loads(line)

    def call(self, name, type_, seconds=40, **fields):
        answer = self.ask(call=name, type=type_, fields=fields, seconds=seconds)
        assert "error" not in answer, answer["error"] + "".join(f"\n{p.text()[-2000:]}" for p in self.started)
        return answer

    def close(self):
        for process in self.started:
            if process.alive():
                process.stop(signal.SIGTERM)
        self.helper.stdin.close()
        self.helper.wait(10)
        self.errors.close()


def test_a_network_that_comes_up_later_is_used(hosts, tmp_path):
    """The node starts where there is no network yet, as a robot does before its radio is up; then an address comes, and another one."""
    address = lambda change, at: ip("-n", PLANNER, "addr", change, f"{at}/24", "dev", "to_robot")
    planner, robot = Host(PLANNER, tmp_path), Host(ROBOT, tmp_path)
    try:
        # Fast DDS never looks for interfaces again: its host must have had a network when it began, ours need not.
        robot.ask(graph="/")
        address("del", "10.77.0.1")
        cable("down")
        node = planner.start("tandem_planner")
        wait_until(lambda: "starts:" in node.text(), 10, "the planner has started")
        time.sleep(4)  # it has announced itself where nobody is
        for last, this in ((None, "10.77.0.1"), ("10.77.0.1", "10.77.0.9")):
            if last:
                address("del", last)
            address("add", this)
            cable("up")
            began = time.monotonic()
            answer = robot.call("/generate_gait", "tandem_msgs/srv/GenerateGait", 40, behaviour="gait1")
            assert answer["success"], answer
            print(f"reached at {this} {time.monotonic() - began:.1f} s after it came up")
        assert "to_robot came up after the start" in node.text(), node.text()
    finally:
        planner.close()
        robot.close()


class Relay:
    """In the middle of the cable: drops every second announcement of an endpoint that the planner's host sends to all (and not again to one)."""

    ANNOUNCEMENTS = (bytes.fromhex("000003c2"), bytes.fromhex("000004c2"))

    def __init__(self):
        ip("-n", PLANNER, "link", "del", "to_robot")
        for host, cable, middle, address in ((PLANNER, "to_robot", "middle_p", "10.77.0.1/24"), (ROBOT, "to_planner", "middle_r", "10.77.0.2/24")):
            ip("link", "add", middle, "type", "veth", "peer", "name", cable, "netns", host)
            ip("link", "set", middle, "up")
            ip("-n", host, "addr", "add", address, "dev", cable)
            ip("-n", host, "link", "set", cable, "up")
            ip("-n", host, "route", "add", "239.255.0.0/16", "dev", cable)
        self.ends = [socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(3)) for _ in range(2)]
        for end, middle in zip(self.ends, ("middle_p", "middle_r"), strict=True):
            end.bind((middle, 0))
        self.dropped, self.lossy, self.running = 0, False, True
        self.thread = threading.Thread(target=self.relay, daemon=True)
        self.thread.start()

    def relay(self):
        while self.running:
            for end in select.select(self.ends, [], [], 0.2)[0]:
                frame, address = end.recvfrom(65536)
                if address[2] == socket.PACKET_OUTGOING or (self.lossy and end is self.ends[0] and self.is_lost(frame)):
                    continue
                if frame[12:14] == b"\x08\x00" and frame[23] == socket.IPPROTO_UDP:
                    frame = frame[:40] + bytes(2) + frame[42:]  # a virtual cable leaves the checksum to hardware; none is as good
                self.ends[end is self.ends[0]].send(frame)

    def is_lost(self, frame):
        """DATA (0x15) of a writer that announces endpoints: its body begins with four bytes, a reader, the writer and the number."""
        head = frame.find(b"RTPS") + 20
        at = next((at for name in self.ANNOUNCEMENTS if (at := frame.find(name)) > 0 and frame[at - 12] == 0x15), None)
        lost = at is not None and frame[head] != 0x0E and frame[at + 8] % 2 == 1
        self.dropped += lost
        return lost

    def close(self):
        self.running = False
        self.thread.join(5)
        for end in self.ends:
            end.close()
        for middle in ("middle_p", "middle_r"):
            ip("link", "del", middle, check=False)


def test_announcements_that_were_lost_are_known_when_they_were_sent_again(hosts, tmp_path):
    """Fast DDS asks three nodes for what it missed of them, and gets it: then it must know it, too."""
    relay, robot, planners = Relay(), Host(ROBOT, tmp_path), None
    graph = lambda: sorted(robot.ask(graph="/announced"))
    try:
        for relay.lossy in (False, True):
            planners = Host(PLANNER, tmp_path)
            for name in ("one", "two", "three"):
                planners.start("tandem_planner", "--ros-args", "-r", f"__ns:=/announced/{name}")
            if not relay.lossy:
                for name in ("one", "two", "three"):
                    assert robot.call(f"/announced/{name}/generate_gait", "tandem_msgs/srv/GenerateGait", 40, behaviour="gait1")["success"]
                time.sleep(2)
                whole = graph()
                assert len(whole) > 90, whole
            wait_until(lambda: graph() == whole, 20, lambda: f"still unknown: {[row for row in whole if row not in graph()]}")
            planners = planners.close()
            own = lambda row: row[0].endswith(("/generate_gaitRequest", "/generate_gaitReply"))
            wait_until(lambda: all(map(own, graph())), 20, graph)
        assert relay.dropped > 5, relay.dropped
    finally:
        for host in filter(None, (planners, robot)):
            host.close()
        relay.close()


def test_walking_survives_a_cut_cable_and_a_killed_planner(hosts, tmp_path):
    planner, robot = Host(PLANNER, tmp_path), Host(ROBOT, tmp_path)
    try:
        plans = planner.start("tandem_planner")
        bridge_options = ["-p", f"mode:={MODE}", "-p", "lockstep_timeout_s:=60.0", "-p", "start_paused:=true"]
        controller = robot.start("tandem_controller", "--ros-args", "-p", f"mode:={MODE}")
        bridge = robot.start("tandem_sim_bridge", "--ros-args", *bridge_options)
        robot.ask(watch="/controller_state", type="tandem_msgs/msg/ControllerState")
        robot.ask(watch="/odom", type="nav_msgs/msg/Odometry")
        planner.ask(watch="/controller_state", type="tandem_msgs/msg/ControllerState")

        states = lambda: robot.ask(received="/controller_state", fields=["mode", "fault", "gait", "step_index", "missed_cycles"])
        mode = lambda: (states() or [[0, "silent"]])[-1][1]
        generate = lambda gait, seconds=40: robot.call(
            "/generate_gait", "tandem_msgs/srv/GenerateGait", seconds, behaviour=gait
        )

        loaded = lambda: controller.text().count('gait "gait1"')
        first = generate("gait1")
        assert first["success"], first
        print(f"first request across the cable answered after {first['seconds']:.2f} s")
        wait_until(lambda: loaded() == 1, 20, "the gait is across the cable")
        for name in ("arm", "stand", "walk"):
            answer = robot.call(f"/{name}", "std_srvs/srv/Trigger")
            assert answer["success"], answer
        robot.call("/pause", "std_srvs/srv/SetBool", data=False)
        wait_until(lambda: mode() == "walking", 60, lambda: f"walking; it is {states()[-1:]}")

        # The cable is out for two seconds.
        walking_since = time.monotonic()
        steps = states()[-1][4]
        cable("down")
        time.sleep(2)
        assert states()[-1][4] > steps, "it walked on while the cable was out"
        received_before = len(planner.ask(received="/controller_state", fields=["mode"]))
        up = time.monotonic()
        cable("up")
        ip("-n", PLANNER, "route", "replace", "239.255.0.0/16", "dev", "to_robot")
        wait_until(lambda: len(planner.ask(received="/controller_state", fields=["mode"])) > received_before, 60, "topics cross again")
        topics = time.monotonic() - up
        again = generate("gait1", 60)
        assert again["success"], again
        print(f"cable back: topics cross after {topics:.2f} s, a request is answered after {time.monotonic() - up:.2f} s")
        wait_until(lambda: loaded() == 2, 30, "the new gait is across the cable")

        # The planner is killed, and started again.
        killed = time.monotonic()
        pids = subprocess.run(["ip", "netns", "pids", PLANNER], capture_output=True, text=True).stdout.split()
        for pid in pids:
            if os.path.basename(os.readlink(f"/proc/{pid}/exe")) == "tandem_planner":
                os.kill(int(pid), signal.SIGKILL)
        wait_until(lambda: not plans.alive(), 10, "the planner is dead")
        planner.start("tandem_planner")
        restarted = generate("gait1", 90)
        assert restarted["success"], restarted
        print(f"planner killed and started again: a request is answered after {time.monotonic() - killed:.2f} s, {restarted['tries']} tries")
        wait_until(lambda: loaded() == 3, 30, "its gait is across the cable")
        steps = states()[-1][4]
        wait_until(lambda: states()[-1][4] > steps + 2, 30, "it walks on")

        # It never stumbled.
        during = [state for state in states() if state[0] >= walking_since]
        assert {state[1] for state in during} == {"walking"} and {state[2] for state in during} == {""}, during[-1]
        poses = robot.ask(
            received="/odom", fields=["pose.pose.position.z", "pose.pose.orientation.x", "pose.pose.orientation.y", "header.stamp.sec"]
        )
        walked = [pose for pose in poses if pose[0] >= walking_since]
        assert all(z > 0.35 and 1 - 2 * (x * x + y * y) > math.cos(0.8) for _, z, x, y, _ in walked), "it fell"
        assert controller.alive() and bridge.alive()
        print(
            f"walked {walked[-1][4] - walked[0][4]} simulated s in {walked[-1][0] - walked[0][0]:.1f} s, "
            f"{during[-1][5] - during[0][5]} cycles missed"
        )
    finally:
        planner.close()
        robot.close()
