"""`tandem adapt`, by message: a Vision 60's own topics under our names, and topic_based_ros2_control's commands on a simulated robot."""

import json
import signal
import subprocess

import pytest
import yaml
from conftest import ROOT, TARGET, wait_until
from test_walk import JOINTS, best_effort

THEIRS = [f"{joint}{leg}" for leg in range(4) for joint in ("hip", "knee")] + [f"abd{leg}" for leg in range(4)]


@pytest.fixture
def adapt(processes):
    started = []

    def start(rules, *arguments):
        started.append(processes("tandem", "adapt", rules, *arguments, name=f"adapt-{rules.split('/')[-1]}"))
        return started[-1]

    yield start
    for process in started:
        assert process.stop(signal.SIGINT) == 0, process.text()


def test_a_vision_60s_topics_are_seen_under_our_names(client, adapt):
    from geometry_msgs.msg import Twist
    from sensor_msgs.msg import Imu, JointState

    process = adapt("config/adapters/vision60.toml")
    received = {"/joint_states": [], "/imu": [], "/cmd_vel": []}
    types = {"/joint_states": JointState, "/imu": Imu, "/cmd_vel": Twist}
    subscriptions = [client.node.create_subscription(types[topic], topic, messages.append, 10) for topic, messages in received.items()]
    publish = {
        topic: client.node.create_publisher(type_, topic, 10)
        for topic, type_ in (("/mcu/state/jointURDF", JointState), ("/mcu/state/imu", Imu), ("/mcu/command/manual_twist", Twist))
    }
    state = JointState(name=THEIRS, position=[0.1 * n for n in range(12)], velocity=[1.0] * 12)
    imu, twist = Imu(), Twist()
    imu.header.frame_id, imu.angular_velocity.z, twist.linear.x = "imu", 0.25, 0.5

    def arrives():
        for topic, message in zip(publish, (state, imu, twist), strict=True):
            publish[topic].publish(message)
        return all(received.values())

    wait_until(arrives, 30, process.text)
    joints = received["/joint_states"][-1]
    assert sorted(joints.name) == sorted(JOINTS) and len(joints.velocity) == 12 and not joints.effort
    by_name = dict(zip(joints.name, joints.position, strict=True))
    assert by_name["front_left_hip_pitch"] == 0.0 and by_name["rear_right_hip_roll"] == pytest.approx(1.1)
    assert received["/imu"][-1].angular_velocity.z == 0.25 and received["/cmd_vel"][-1].linear.x == 0.5
    # A message that lacks joints is not handed on, and the log says so.
    publish["/mcu/state/jointURDF"].publish(JointState(name=["hip0"], position=[0.0]))
    wait_until(lambda: "not handed on" in process.text() and "knee0" in process.text(), 10, process.text)
    for subscription in subscriptions:
        client.node.destroy_subscription(subscription)
    for publisher in publish.values():
        client.node.destroy_publisher(publisher)


def test_commands_as_topic_based_ros2_control_sends_them_hold_a_simulated_robot(client, processes, adapt):
    from nav_msgs.msg import Odometry
    from sensor_msgs.msg import JointState
    from std_srvs.srv import SetBool
    from tandem_msgs.msg import JointCommand

    remap = ["--ros-args", "-r", "__ns:=/rc"]
    parameters = ("initial_posture:=stand", "command_timeout_s:=5.0", "start_paused:=true")
    bridge = processes("tandem_sim_bridge", *remap, "-r", "/clock:=/rc/clock", *(word for one in parameters for word in ("-p", one)))
    process = adapt("config/adapters/ros2_control.toml", *remap)
    states, odometry, adapted = [], [], []
    subscriptions = [
        client.node.create_subscription(JointState, "/rc/joint_states", lambda message: states.__setitem__(slice(None), [message]), best_effort(1)),
        client.node.create_subscription(Odometry, "/rc/odom", odometry.append, best_effort()),
        client.node.create_subscription(JointCommand, "/rc/joint_command", adapted.append, 10),
    ]
    commands = client.node.create_publisher(JointState, "/rc/joint_commands", 10)
    stand = stand_rad()

    def held(until):
        def asked():
            commands.publish(JointState(name=JOINTS, position=stand))
            return until()

        wait_until(asked, 60, lambda: f"{process.text()}\n{bridge.text()}")

    # Without commands it would sink: time begins once they come.
    held(lambda: len(adapted) > 20 and client.node.count_subscribers("/rc/joint_command") == 2)
    assert client.call(client.service(SetBool, "/rc/pause"), SetBool.Request(data=False)).success
    held(lambda: odometry and odometry[-1].header.stamp.sec >= 6)
    assert odometry[-1].pose.pose.position.z > 0.4, "it stands"
    measured = dict(zip(states[0].name, states[0].position, strict=True))
    assert all(abs(measured[name] - value) < 0.15 for name, value in zip(JOINTS, stand, strict=True)), measured
    for subscription in subscriptions:
        client.node.destroy_subscription(subscription)
    client.node.destroy_publisher(commands)
    assert bridge.stop() == 0


def stand_rad():
    import tomllib

    legs = tomllib.loads((ROOT / "config/robots/vision60/robot.toml").read_text())["legs"]
    return [angle for leg in legs for angle in leg["stand_rad"]]


def test_twist_mux_lets_a_person_drive_before_a_program():
    """The file for twist_mux, which has no wheel: what it must say for the controller's own timeout and for whoever holds the button."""
    mux = yaml.safe_load((ROOT / "config/twist_mux.yaml").read_text())["twist_mux"]["ros__parameters"]
    topics, locks = mux["topics"], mux["locks"]
    assert max(topics, key=lambda name: topics[name]["priority"]) == "person"
    assert all(lock["priority"] > topics["person"]["priority"] for lock in locks.values())
    described = (ROOT / "docs/interfaces.md").read_text()
    timeout = float(described.split("| `cmd_vel_timeout_s` | double | ", 1)[1].split(" ", 1)[0])
    assert all(topic["timeout"] <= timeout for topic in topics.values())


def test_a_file_that_cannot_be_meant_is_refused_in_one_sentence(tmp_path):
    file = tmp_path / "rules.toml"
    file.write_text('format = "tandem-adapter"\nversion = 1\n[[twist]]\nfrom = "a"\nto = "joint_command"\n')
    done = subprocess.run([TARGET / "tandem", "adapt", file], capture_output=True, text=True, cwd=ROOT, timeout=20)
    assert done.returncode == 1 and "moves a robot" in done.stderr, json.dumps(done.stderr)
