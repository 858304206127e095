"""End to end over DDS in lockstep: a real rclpy client asks for gaits and watches the robot walk them."""

import json
import math
import threading
import time

import pytest
from conftest import Client, wait_until

JOINTS = [
    f"{leg}_{joint}"
    for leg in ("front_left", "rear_left", "front_right", "rear_right")
    for joint in ("hip_roll", "hip_pitch", "knee")
]
# Mean |knee torque| of the same gaits in an independent MuJoCo program (docs/measurements/planning.md), Nm.
KNEE_TORQUE_NM = {"gait1": 16.5, "amble": 16.69}


def best_effort(depth=1000):
    from rclpy.qos import QoSProfile, ReliabilityPolicy

    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)


def latched():
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    return QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def seconds(stamp):
    return stamp.sec + 1e-9 * stamp.nanosec


class Robot:
    """The three nodes in a namespace, and what is received of them."""

    def __init__(self, processes, ros, namespace, planner=True, parameters=(), controller=(), mode="lockstep"):
        import rclpy
        from nav_msgs.msg import Odometry
        from sensor_msgs.msg import JointState
        from tandem_msgs.msg import ControllerState, Gait

        self.namespace = namespace
        remap = ["--ros-args", "-r", f"__ns:={namespace or '/'}"]
        self.nodes = []
        if planner:
            self.nodes.append(processes("tandem_planner", *remap))
        set_ = lambda values: [part for value in values for part in ("-p", value)]
        self.nodes.append(processes("tandem_controller", *remap, *set_([f"mode:={mode}", *controller])))
        if namespace:
            remap += ["-r", f"/clock:={namespace}/clock"]  # one time for each simulation
        bridge = [f"mode:={mode}", "start_paused:=true", "lockstep_timeout_s:=60.0", *parameters]
        self.nodes.append(processes("tandem_sim_bridge", *remap, *set_(bridge)))
        self.client = Client("tester" + namespace.replace("/", "_"))
        self.odometry, self.torques, self.states, self.gaits = [], [], [], []
        node = self.client.node
        node.create_subscription(Odometry, f"{namespace}/odom", self.odometry.append, best_effort())
        node.create_subscription(ControllerState, f"{namespace}/controller_state", self.states.append, 100)
        node.create_subscription(Gait, f"{namespace}/gait", self.gaits.append, latched())
        # At 1 kHz and more rclpy's executor would do nothing else: a thread takes the newest joint state now and then.
        self.joint_names = None
        self.aside = rclpy.create_node("aside" + namespace.replace("/", "_"))
        self.joints = self.aside.create_subscription(JointState, f"{namespace}/joint_states", print, best_effort(1))
        self.watching = True
        self.watcher = threading.Thread(target=self._watch_joints, daemon=True)
        self.watcher.start()

    def _watch_joints(self):
        while self.watching:
            time.sleep(0.005)
            with self.joints.handle:
                taken = self.joints.handle.take_message(self.joints.msg_type, False)
            if taken is not None:
                message = taken[0]
                self.joint_names = message.name
                self.torques.append((seconds(message.header.stamp), [abs(value) for value in message.effort]))

    def service(self, type_, name):
        return self.client.service(type_, f"{self.namespace}/{name}")

    def trigger(self, name):
        from std_srvs.srv import Trigger

        response = self.client.call(self.service(Trigger, name), Trigger.Request())
        assert response.success, f"{name}: {response.message}"

    def pause(self, paused):
        from std_srvs.srv import SetBool

        assert self.client.call(self.service(SetBool, "pause"), SetBool.Request(data=paused)).success

    def generate(self, **fields):
        from tandem_msgs.srv import GenerateGait

        return self.client.call(self.service(GenerateGait, "generate_gait"), GenerateGait.Request(**fields), 60)

    def mode(self):
        return self.states[-1].mode if self.states else None

    def time(self):
        return seconds(self.odometry[-1].header.stamp) if self.odometry else 0.0

    def check(self):
        for node in self.nodes:
            assert node.alive(), f"{node.process.args[0]} ended:\n{node.text()}"
        # Armed and not asked for more yet, it damps and says so.
        assert not self.states or self.states[-1].fault in ("", "armed"), self.states[-1]

    def wait(self, condition, wall_seconds, what):
        def checked():
            self.check()
            return condition()

        return wait_until(checked, wall_seconds, lambda: f"{what}; mode {self.mode()}, time {self.time():.2f} s")

    def close(self):
        self.watching = False
        self.watcher.join()
        self.aside.destroy_node()
        self.client.close()
        for node in reversed(self.nodes):
            assert node.stop() == 0, node.text()


@pytest.fixture(scope="module")
def robot(processes, ros):
    robot = Robot(processes, ros, "")
    yield robot
    robot.close()


def upright(odometry):
    q = odometry.pose.pose.orientation
    return 1 - 2 * (q.x * q.x + q.y * q.y) > math.cos(0.8) and odometry.pose.pose.position.z > 0.35


@pytest.mark.parametrize("name", ["gait1", "amble"])
def test_a_gait_asked_for_over_the_service_walks_for_twenty_seconds(robot, name):
    response = robot.generate(behaviour=name)
    assert response.success and response.status == "converged", response.message
    assert response.gait == name
    # The gait comes on the latched topic, under the stamp that the answer gives.
    robot.wait(lambda: robot.gaits and robot.gaits[-1].header.stamp == response.gait_stamp, 10, "the gait on its topic")
    gait = robot.gaits[-1]
    assert gait.solver == response.solver
    assert (gait.step_duration_s, gait.step_length_m) == (response.step_duration_s, response.step_length_m)
    assert (gait.version, gait.robot, gait.name, gait.bezier_degree) == (1, "vision60", name, 5)
    assert list(gait.joint_names) == JOINTS
    assert len(gait.coefficients_rad) == len(gait.reference_coefficients_rad) == 72
    assert (list(gait.mirror_leg), list(gait.mirror_sign)) == ([2, 3, 0, 1], [-1.0, 1.0, 1.0])
    asked = {"gait1": (0.5 / 2.5, 0.0), "amble": (0.5 / 2.83, 0.35)}[name]
    assert gait.step_duration_s == pytest.approx(asked[0], rel=0.0101), "within the planner's tolerance of 1 %"
    assert gait.step_length_m == pytest.approx(asked[1] * gait.step_duration_s, abs=1e-6)
    assert gait.solver.status == "converged" and 0 < gait.solver.iterations < 100
    assert gait.solver.max_violation <= 1e-5 and 0 < gait.solver.solve_time_s < 4
    assert json.loads(gait.request_json)["behaviour"] == name

    robot.pause(False)
    robot.trigger("reset")
    robot.trigger("arm")
    robot.trigger("stand")
    robot.wait(lambda: robot.mode() == "standing", 60, "standing")
    robot.trigger("walk")
    robot.wait(lambda: robot.mode() == "walking", 60, "walking")
    assert robot.states[-1].gait == name
    began = robot.time()
    robot.odometry.clear()
    robot.torques.clear()
    robot.wait(lambda: robot.time() > began + 20, 120, "20 s of walking")
    robot.pause(True)
    walk = list(robot.odometry)
    assert robot.mode() == "walking"
    assert all(upright(message) for message in walk), "it fell"
    assert list(robot.joint_names) == JOINTS

    settled = [message for message in walk if seconds(message.header.stamp) > began + 10]
    first, last = settled[0], settled[-1]
    duration = seconds(last.header.stamp) - seconds(first.header.stamp)
    moved = [getattr(last.pose.pose.position, axis) - getattr(first.pose.pose.position, axis) for axis in "xy"]
    speed = math.hypot(*moved) / duration
    if name == "amble":
        assert speed == pytest.approx(0.35, rel=0.10)
    else:
        assert speed <= 0.03
    knees = [torque for when, torques in robot.torques if when > began + 2 for torque in torques[2::3]]
    mean = sum(knees) / len(knees)
    print(f"{name}: {speed:.3f} m/s, mean |knee torque| {mean:.2f} Nm")
    assert mean == pytest.approx(KNEE_TORQUE_NM[name], rel=0.05)

    robot.pause(False)
    robot.trigger("stop")
    robot.wait(lambda: robot.mode() == "standing", 60, "standing")
    robot.trigger("sit")
    robot.wait(lambda: robot.mode() == "disarmed", 60, "disarmed")


def test_a_crawl_asked_for_over_the_service_walks_as_fast_as_it_was_asked_to(robot):
    asked = {"step_duration_s": [0.4], "speed_m_s": [0.1], "clearance_m": [0.08]}
    response = robot.generate(behaviour="amble", schedule="crawl", **asked)
    assert response.success and response.gait == "amble_crawl", response.message
    robot.wait(lambda: robot.gaits and robot.gaits[-1].header.stamp == response.gait_stamp, 10, "the gait on its topic")
    gait = robot.gaits[-1]
    assert gait.version == 3 and not gait.lead
    assert [list(domain.stance_legs) for domain in gait.cycle] == [[0, 2, 3], [1, 2, 3], [0, 1, 2], [0, 1, 3]]

    robot.pause(False)
    robot.trigger("reset")
    for asked_for, mode in (("arm", None), ("stand", "standing"), ("walk", "walking")):
        robot.trigger(asked_for)
        if mode:
            robot.wait(lambda: robot.mode() == mode, 60, mode)
    assert robot.states[-1].gait == "amble_crawl"
    began = robot.time()
    robot.odometry.clear()
    robot.wait(lambda: robot.time() > began + 12, 120, "12 s of walking")
    robot.pause(True)
    walk = [message for message in robot.odometry if seconds(message.header.stamp) > began + 4]
    assert robot.mode() == "walking" and all(upright(message) for message in walk), "it fell"
    first, last = walk[0], walk[-1]
    ahead = last.pose.pose.position.x - first.pose.pose.position.x
    speed = ahead / (seconds(last.header.stamp) - seconds(first.header.stamp))
    print(f"crawl: {speed:.3f} m/s")
    assert speed == pytest.approx(0.1, rel=0.15)

    robot.pause(False)
    robot.trigger("stop")
    robot.wait(lambda: robot.mode() == "standing", 60, "standing")
    robot.trigger("sit")
    robot.wait(lambda: robot.mode() == "disarmed", 60, "disarmed")


@pytest.mark.parametrize(
    "fields, expected",
    [
        ({"behaviour": "moonwalk"}, "gait1, gait2, gait3, gait4, amble"),
        ({"behaviour": "amble", "speed_m_s": [5.0]}, "speed_m_s is 5"),
        ({"behaviour": "amble", "speed_m_s": [math.nan]}, "speed_m_s is NaN"),
        ({"behaviour": "gait1", "clearance_m": [0.4]}, "clearance_m"),
        ({"behaviour": "gait1", "step_duration_s": [0.3], "step_frequency_hz": [3.0]}, "at most one"),
        ({"behaviour": "gait1", "step_frequency_hz": [0.0]}, "step_frequency_hz is 0"),
        ({"behaviour": "amble", "schedule": "gallop"}, "expected one of trot, crawl, pace, bound"),
        ({"behaviour": "amble", "schedule": "crawl", "stable": True}, 'stable is given beside schedule "crawl"'),
    ],
)
def test_a_bad_request_gets_one_clear_answer(robot, fields, expected):
    response = robot.generate(**fields)
    assert not response.success and response.status == "invalid_request"
    assert expected in response.message and "\n" not in response.message


def test_a_gait_file_cut_in_half_is_refused(robot):
    from tandem_msgs.srv import LoadGait

    load = robot.service(LoadGait, "load_gait")
    whole = json.dumps({"format": "tandem-gait", "version": 1, "robot": "vision60"})
    response = robot.client.call(load, LoadGait.Request(json=whole[: len(whole) // 2]))
    assert not response.success and "Is it whole?" in response.message


def test_the_same_run_twice_is_the_same_to_the_bit(processes, ros):
    """All requests while time stands still, then 4 s; another controller, another bridge, the same again."""

    def run(namespace):
        robot = Robot(processes, ros, namespace, parameters=["seed:=7", "joint_noise_rad:=0.02"])
        response = robot.generate(behaviour="amble")
        assert response.success, response.message
        wait_until(lambda: 'gait "amble"' in robot.nodes[1].text(), 10, "the controller has the gait")
        for request in ("reset", "arm", "stand", "walk"):
            robot.trigger(request)
        robot.odometry.clear()
        robot.pause(False)
        robot.wait(lambda: robot.time() > 8, 120, "8 s")
        robot.pause(True)
        time.sleep(0.2)
        assert robot.mode() == "walking"
        trajectory = {}
        for message in robot.odometry:
            pose, twist = message.pose.pose, message.twist.twist
            trajectory[seconds(message.header.stamp)] = (
                pose.position.x, pose.position.y, pose.position.z,
                pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w,
                twist.linear.x, twist.linear.y, twist.linear.z, twist.angular.x, twist.angular.y, twist.angular.z,
            )  # fmt: skip
        robot.close()
        return trajectory

    first, second = run("/first"), run("/second")
    common = sorted(stamp for stamp in first.keys() & second.keys() if stamp <= 8)
    assert len(common) > 300, f"{len(common)} of 400 messages were received both times"
    different = [stamp for stamp in common if first[stamp] != second[stamp]]
    assert not different, f"the runs part at {different[0]} s"
    assert max(first[stamp][0] for stamp in common) > 0.3, "it walked"
