"""Over DDS in lockstep, in balance: a client drives by cmd_vel, the controller's odom is held against the simulation's truth."""

import math
import os
import pty
import signal
import subprocess
import termios
import threading
import time

import pytest
from conftest import ROOT, wait_until
from test_walk import Robot, best_effort, seconds


class Driver:
    """Publishes a velocity 50 times a second, as teleop_twist_keyboard and Nav2 do, until it is asked to be silent."""

    def __init__(self, node, stamped=False):
        from geometry_msgs.msg import Twist, TwistStamped

        # Its stamp stays at 1970 and its frame empty: neither is looked at.
        self.message = TwistStamped() if stamped else Twist()
        self.twist = self.message.twist if stamped else self.message
        self.publisher = node.create_publisher(type(self.message), "cmd_vel", 10)
        self.publishes, self.goes_on = False, True
        self.thread = threading.Thread(target=self._speak, daemon=True)
        self.thread.start()

    def _speak(self):
        while self.goes_on:
            if self.publishes:
                self.publisher.publish(self.message)
            time.sleep(0.02)

    def ask(self, forward_m_s, left_m_s, yaw_rad_s):
        self.twist.linear.x, self.twist.linear.y, self.twist.angular.z = forward_m_s, left_m_s, yaw_rad_s
        self.publishes = True

    def close(self):
        self.goes_on = False
        self.thread.join()


def driven(processes, ros, tmp_path, *more, stamped=False):
    from nav_msgs.msg import Odometry

    # Simulated time runs several times as fast as this client, which a busy machine holds up for a tenth of a second.
    controller = ["balance:=true", "cmd_vel_timeout_s:=2.0", f"record_root:={tmp_path}", *more]
    robot = Robot(processes, ros, "", parameters=["ground_truth:=true"], controller=controller)
    robot.truth = []
    robot.client.node.create_subscription(Odometry, "ground_truth/odom", robot.truth.append, best_effort())
    robot.driver = Driver(robot.client.node, stamped)
    yield robot
    robot.driver.close()
    robot.close()


@pytest.fixture
def robot(processes, ros, tmp_path):
    yield from driven(processes, ros, tmp_path)


@pytest.fixture
def heeding(processes, ros, tmp_path):
    yield from driven(processes, ros, tmp_path, "cmd_vel_walks:=true")


@pytest.fixture
def stamped(processes, ros, tmp_path):
    yield from driven(processes, ros, tmp_path, "cmd_vel_stamped:=true", stamped=True)


def yaw(message):
    q = message.pose.pose.orientation
    return math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))


def since(messages, from_s):
    return [message for message in messages if seconds(message.header.stamp) >= from_s]


def means(messages):
    twists = [message.twist.twist for message in messages]
    return [sum(of(twist) for twist in twists) / len(twists) for of in
            (lambda t: t.linear.x, lambda t: t.linear.y, lambda t: t.angular.z)]  # fmt: skip


def walk_for(robot, duration_s, what):
    from_s, begun = robot.time(), time.monotonic()
    robot.wait(lambda: robot.time() > from_s + duration_s, 120, what)
    print(f"{what}: {(robot.time() - from_s) / (time.monotonic() - begun):.2f} times as fast as real time")
    return from_s


def moved(messages):
    a, b = (message.pose.pose.position for message in (messages[0], messages[-1]))
    turned = yaw(messages[-1]) - yaw(messages[0])
    return math.hypot(b.x - a.x, b.y - a.y), math.remainder(turned, math.tau)


def drive_again_and_press_the_button(robot):
    """Out of standing. The button damps, whatever is asked for."""
    from std_srvs.srv import SetBool

    robot.trigger("walk")
    robot.driver.ask(0.3, 0.0, -0.3)
    robot.wait(lambda: robot.mode() == "walking", 60, "walking again")
    walk_for(robot, 2, "driving again")
    assert means(since(robot.truth, robot.time() - 0.7))[0] > 0.15, "it goes again"
    pressed = robot.client.call(robot.service(SetBool, "emergency_stop"), SetBool.Request(data=True))
    assert pressed.success
    wait_until(lambda: robot.mode() == "damping", 20, lambda: f"{robot.states[-1]}")
    assert robot.states[-1].fault == "emergency_stop"


def test_it_is_driven_by_cmd_vel_with_odometry_stops_and_is_verified(robot, tmp_path):
    from geometry_msgs.msg import WrenchStamped
    from tandem_msgs.srv import StartRecording, StopRecording

    assert robot.generate(behaviour="amble").success
    robot.wait(lambda: robot.gaits, 10, "the gait")
    start = robot.service(StartRecording, "start_recording")
    assert robot.client.call(start, StartRecording.Request(folder="drive")).success
    for request in ("arm", "stand", "walk"):
        robot.trigger(request)
    robot.driver.ask(0.0, 0.0, 0.0)
    robot.pause(False)
    robot.wait(lambda: robot.mode() == "walking", 90, "walking")
    walk_for(robot, 3, "stepping in place")

    robot.driver.ask(0.2, 0.05, 0.3)
    walk_for(robot, 2, "speeding up")
    from_s = walk_for(robot, 4, "driving")
    truth, reported = since(robot.truth, from_s), since(robot.odometry, from_s)
    for got, asked, allowed in zip(means(truth), (0.2, 0.05, 0.3), (0.08, 0.04, 0.06), strict=True):
        assert got == pytest.approx(asked, abs=allowed), means(truth)
    for got, true in zip(means(reported), means(truth), strict=True):
        assert got == pytest.approx(true, abs=0.03), (means(reported), means(truth))
    (far, turned), (reported_far, reported_turned) = moved(truth), moved(reported)
    print(f"driven {means(truth)}, went {far:.3f} m, odom says {reported_far:.3f} m; turned {turned:.3f}, odom {reported_turned:.3f} rad")
    assert reported_far == pytest.approx(far, abs=0.05) and reported_turned == pytest.approx(turned, abs=0.05)
    last = reported[-1]
    assert (last.header.frame_id, last.child_frame_id) == ("odom", "base_link")
    assert all(0 < last.pose.covariance[7 * n] < 1 and 0 < last.twist.covariance[7 * n] < 1 for n in range(6))
    assert len(reported) >= 0.9 * len(truth), "50 a second"

    # The planner is killed while it drives, and it is pushed by 30 N s.
    planner = robot.nodes.pop(0)
    planner.process.kill()
    planner.process.wait()
    pushes = robot.client.node.create_publisher(WrenchStamped, "push", 10)
    robot.wait(lambda: pushes.get_subscription_count() == 1, 20, "the push has a subscriber")
    push = WrenchStamped()
    push.wrench.force.y = 300.0
    from_s = robot.time()
    pushes.publish(push)
    walk_for(robot, 2, "pushed")
    off = [math.hypot(m.twist.twist.linear.x - 0.2, m.twist.twist.linear.y - 0.05) for m in since(robot.truth, from_s)]
    assert max(off) > 0.3, f"it was not pushed: {max(off)}"

    # The client falls silent: it steps in place.
    robot.driver.publishes = False
    walk_for(robot, 4, "stale")
    from_s = walk_for(robot, 2, "in place")
    assert all(abs(value) < 0.05 for value in means(since(robot.truth, from_s))), means(since(robot.truth, from_s))
    assert robot.mode() == "walking"

    robot.trigger("stop")
    robot.wait(lambda: robot.mode() == "standing", 60, "standing")

    drive_again_and_press_the_button(robot)
    stop = robot.service(StopRecording, "stop_recording")
    assert robot.client.call(stop, StopRecording.Request()).success
    verified = subprocess.run([ROOT / "target/release/tandem", "bag", "verify", tmp_path / "drive"], capture_output=True, text=True)
    print(verified.stdout)
    assert verified.returncode == 0 and "to the bit" in verified.stdout, verified.stdout + verified.stderr


def stand_with_the_amble(robot):
    assert robot.generate(behaviour="amble").success
    robot.wait(lambda: robot.gaits, 10, "the gait")
    for request in ("arm", "stand"):
        robot.trigger(request)
    robot.pause(False)
    robot.wait(lambda: robot.mode() == "standing", 60, "standing")
    walk_for(robot, 3, "standing for a while")


def test_a_velocity_begins_a_walk_of_a_robot_that_stands_and_it_stands_again_after_it(heeding):
    robot = heeding
    stand_with_the_amble(robot)
    assert robot.mode() == "standing"
    for _ in range(2):
        robot.driver.ask(0.3, 0.0, 0.0)
        robot.wait(lambda: robot.mode() == "walking", 60, "walking")
        far, _ = moved(since(robot.truth, walk_for(robot, 6, "driving")))
        print(f"went {far:.2f} m in 6 s at 0.3 m/s from standing")
        assert far >= 0.3 * (6 - 1), "the walk grows for the first 2 s"
        robot.driver.publishes = False
        robot.wait(lambda: robot.mode() == "standing", 60, "standing again")
    # A stop holds although the client goes on.
    robot.driver.ask(0.3, 0.0, 0.0)
    robot.wait(lambda: robot.mode() == "walking", 60, "walking")
    robot.trigger("stop")
    robot.wait(lambda: robot.mode() == "standing", 60, "standing")
    walk_for(robot, 4, "standing although it is asked to go")
    assert robot.mode() == "standing"


def test_with_cmd_vel_stamped_it_is_driven_by_twists_with_a_stamp(stamped):
    from geometry_msgs.msg import TwistStamped

    robot = stamped
    types = dict(robot.client.node.get_topic_names_and_types())
    assert types[robot.driver.publisher.topic_name] == [f"geometry_msgs/msg/{TwistStamped.__name__}"], types
    assert robot.generate(behaviour="amble").success
    robot.wait(lambda: robot.gaits, 10, "the gait")
    for request in ("arm", "stand", "walk"):
        robot.trigger(request)
    robot.driver.ask(0.2, 0.0, 0.3)
    robot.pause(False)
    robot.wait(lambda: robot.mode() == "walking", 90, "walking")
    walk_for(robot, 4, "speeding up")
    ahead, left, turning = means(since(robot.truth, walk_for(robot, 4, "driving")))
    print(f"driven by TwistStamped: {ahead:.3f} {left:.3f} {turning:.3f}")
    assert (ahead, left, turning) == (pytest.approx(0.2, abs=0.08), pytest.approx(0.0, abs=0.04), pytest.approx(0.3, abs=0.06))
    # And one that falls silent is stale.
    robot.driver.publishes = False
    walk_for(robot, 4, "stale")
    assert all(abs(value) < 0.05 for value in means(since(robot.truth, walk_for(robot, 2, "in place"))))


class Terminal:
    """tandem drive in a terminal of its own, with a hand on its keys."""

    def __init__(self):
        self.hand, self.side = pty.openpty()
        self.before = termios.tcgetattr(self.side)
        self.process = subprocess.Popen([ROOT / "target/release/tandem", "drive", "--hold", "2"], stdin=self.side, stdout=self.side, stderr=self.side)
        self.text, self.key, self.goes_on = b"", b"", True
        self.threads = [threading.Thread(target=work, daemon=True) for work in (self._read, self._type)]
        for thread in self.threads:
            thread.start()

    def _read(self):
        while self.goes_on:
            self.text = (self.text + os.read(self.hand, 4096))[-4096:]

    def _type(self):
        """A key that is held repeats."""
        while self.goes_on:
            if self.key:
                os.write(self.hand, self.key)
            time.sleep(0.05)

    def line(self):
        return self.text.rsplit(b"\r", 1)[-1].decode(errors="replace")

    def close(self):
        self.process.kill()
        self.goes_on = False


@pytest.fixture
def terminal():
    terminal = Terminal()
    yield terminal
    terminal.close()


def test_a_person_drives_from_a_terminal_and_the_space_bar_stops(heeding, terminal):
    robot = heeding
    stand_with_the_amble(robot)
    wait_until(lambda: "| standing" in terminal.line(), 20, terminal.line)
    terminal.key = b"i"
    robot.wait(lambda: robot.mode() == "walking", 60, "walking")
    walk_for(robot, 3, "speeding up")
    from_s = walk_for(robot, 4, "driven by a key")
    ahead, left, turning = means(since(robot.truth, from_s))
    print(f"driven by a key: {ahead:.3f} {left:.3f} {turning:.3f}; the line: {terminal.line()}")
    assert ahead > 0.2 and abs(left) < 0.05 and abs(turning) < 0.05
    wait_until(lambda: "asked +0.30" in terminal.line() and "| walking" in terminal.line(), 10, terminal.line)
    terminal.key = b"j"
    walk_for(robot, 2, "turning")
    assert means(since(robot.truth, walk_for(robot, 2, "turning")))[2] > 0.35
    terminal.key = b""
    os.write(terminal.hand, b" ")
    wait_until(lambda: robot.mode() == "damping", 20, lambda: f"{robot.states[-1]}")
    assert robot.states[-1].fault == "emergency_stop"
    wait_until(lambda: "EMERGENCY STOP" in terminal.line(), 10, terminal.line)
    terminal.process.send_signal(signal.SIGINT)
    assert terminal.process.wait(10) == 0, terminal.text
    assert termios.tcgetattr(terminal.side) == terminal.before, "the terminal is as it was"
