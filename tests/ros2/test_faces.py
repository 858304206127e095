"""Every row of docs/interfaces.md with rclpy's own publishers, subscriptions and clients: the topics, services and parameters of the
three nodes, what they carry checked both ways. The planner's are in test_planner.py, lifecycle's in test_lifecycle.py."""

import itertools
import json
import math
import re
import subprocess
import time

import pytest
from conftest import RECORDINGS, ROOT, TARGET, wait_until
from test_walk import JOINTS, Robot, best_effort, latched, seconds

LEGS = ["front_left", "rear_left", "front_right", "rear_right"]
GRAVITY_M_S2 = 9.81
NODES = ["planner", "controller", "sim_bridge"]


def table(node):
    """{parameter: (type, default, range, set)} as docs/interfaces.md says; test_interfaces.py holds that against the nodes."""
    text = (ROOT / "docs/interfaces.md").read_text().split(f"<!-- parameters: {node} -->\n", 1)[1].split("<!-- end -->", 1)[0]
    rows = [[cell.strip() for cell in line.strip().strip("|").split("|")] for line in text.splitlines()[2:]]
    return {row[0].strip("`"): [*row[1:4], row[5]] for row in rows}


def another(name, type_, default, span):
    """A value that the parameter takes and that is not its default."""
    if name == "autostart":
        return False
    if type_ == "bool":
        return default != "True"
    if " to " in span:
        low, high = (float(bound) for bound in span.split(" to "))
        low, high = max(low, -1e6), min(high, 1e6)
        if type_ == "integer":
            return int(low) if int(float(default)) != int(low) else int(low) + 1
        # Not representable in fewer digits than a double has: what comes back must be the very number.
        value = low + (high - low) / 3
        return value if value != float(default) else low
    choices = re.split(r",? or |, ", span) if " or " in span else []
    if choices:
        return next(choice for choice in choices if choice != default)
    return {"joint_prefix": "left_", "frame_prefix": "left/"}.get(name, "config/another")


def start(processes, node, namespace, *parameters, file=None):
    given = ["--params-file", file] if file else []
    given += [part for parameter in parameters for part in ("-p", parameter)]
    return processes(f"tandem_{node}", "--ros-args", "-r", f"__ns:={namespace}", *given, name=f"{namespace.strip('/')}-{node}")


@pytest.mark.parametrize("node", NODES)
def test_every_parameter_is_taken_from_a_file_and_read_back(client, processes, tmp_path, node):
    from rcl_interfaces.srv import GetParameters, SetParameters
    from rcl_interfaces.msg import Parameter, ParameterValue
    from rclpy.parameter import parameter_value_to_python

    # What contradicts another value is given to a node of its own.
    alone = {"controller": {"mode": "lockstep", "simulation_start_on_gait": True}, "sim_bridge": {"timestep_s": 0.00025}}.get(node, {})
    parameters = {name: another(name, *row[:3]) for name, row in table(node).items() if name not in alone}
    if node == "sim_bridge":
        parameters["control_period_s"] = 0.002  # a multiple of the physics step
    # Unlike its default each, and given in a file as ROS 2 writes them.
    assert all(str(value) != table(node)[name][1] for name, value in parameters.items()), parameters
    file = tmp_path / "parameters.yaml"
    file.write_text(f"/set/{node}:\n  ros__parameters:\n" + "".join(f"    {name}: {json.dumps(value)}\n" for name, value in parameters.items()))
    process = start(processes, node, "/set", file=file)
    other = start(processes, node, "/other", "autostart:=false", *(f"{name}:={json.dumps(value)}" for name, value in alone.items()))
    get = client.service(GetParameters, f"/set/{node}/get_parameters")
    names = list(parameters)
    values = client.call(get, GetParameters.Request(names=names)).values
    assert dict(zip(names, map(parameter_value_to_python, values), strict=True)) == parameters
    values = client.call(client.service(GetParameters, f"/other/{node}/get_parameters"), GetParameters.Request(names=list(alone))).values
    assert dict(zip(alone, map(parameter_value_to_python, values), strict=True)) == alone
    # At run time: what may be set is set, what may not is refused by name, and so is another type.
    set_ = client.service(SetParameters, f"/set/{node}/set_parameters")
    for name, row in table(node).items():
        type_, when, value = row[0], row[3], {**parameters, **alone}[name]
        field = {"bool": "bool_value", "integer": "integer_value", "double": "double_value", "string": "string_value"}[type_]
        number = {"bool": 1, "integer": 2, "double": 3, "string": 4}[type_]
        fitting = ParameterValue(type=number, **{field: value})
        wrong = ParameterValue(type=4, string_value="x") if type_ != "string" else ParameterValue(type=2, integer_value=3)
        for given, allowed, reason in [(fitting, when == "any time", "read-only"), (wrong, False, name)]:
            request = SetParameters.Request(parameters=[Parameter(name=name, value=given)])
            (result,) = client.call(set_, request).results
            assert result.successful == allowed, (name, result)
            assert allowed or (name in result.reason and reason in result.reason), (name, result)
    assert process.stop() == 0, process.text()
    assert other.stop() == 0, other.text()


@pytest.mark.parametrize("node", NODES)
def test_every_bound_of_a_parameter_holds(processes, node):
    """One start for each number out of its range and each word that is none of its choices, several at once."""
    refusals = []
    for name, (type_, _, span, _) in table(node).items():
        if " to " in span:
            low, high = (float(bound) for bound in span.split(" to "))
            value = math.ceil(high) + 1 if type_ == "integer" else 2 * high + 1
            if value < 2**62:
                refusals.append((name, f"{name}:={value}"))
            refusals.append((name, f"{name}:={math.floor(low) - 1 if type_ == 'integer' else low - 1.0}"))
        elif " or " in span:
            refusals.append((name, f"{name}:=neither"))
    assert len(refusals) >= (4 if node == "planner" else 20)
    for first in range(0, len(refusals), 8):
        started = [(name, given, start(processes, node, "/bounds", given)) for name, given in refusals[first : first + 8]]
        for name, given, process in started:
            wait_until(lambda process=process: not process.alive(), 20, f"{node} -p {given} ends")
            last_line = process.text().strip().splitlines()[-1]
            assert process.process.returncode == 1 and last_line.startswith(f"tandem_{node}: ") and name in last_line and "expected" in last_line, (given, last_line)


@pytest.fixture(scope="module")
def robot(processes, ros):
    robot = Robot(processes, ros, "/faced", planner=False, parameters=["frame_prefix:=left/", "odometry_rate_hz:=200.0", "imu_rate_hz:=200.0"])
    yield robot
    robot.close()


class Received:
    """What comes on every topic that the robot publishes, the newest last."""

    def __init__(self, node, namespace, slow=False):
        from diagnostic_msgs.msg import DiagnosticArray
        from geometry_msgs.msg import WrenchStamped
        from nav_msgs.msg import Odometry
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import Imu, JointState
        from std_msgs.msg import Float64, String
        from tandem_msgs.msg import ControllerState, JointCommand

        own = lambda name: name if name.startswith("/") else f"{namespace}/{name}"
        topics = {
            "joint_states": (JointState, best_effort()), "joint_command": (JointCommand, best_effort()), "imu": (Imu, best_effort()),
            "odom": (Odometry, best_effort()), "clock": (Clock, best_effort()), "real_time_factor": (Float64, best_effort()),
            "robot_description": (String, latched()), "controller_state": (ControllerState, 10), "/diagnostics": (DiagnosticArray, 10),
            **{f"ground_force/{leg}": (WrenchStamped, best_effort()) for leg in LEGS},
        }  # fmt: skip
        try:
            from tf2_msgs.msg import TFMessage

            topics["/tf"] = (TFMessage, best_effort())
        except ImportError:
            pass  # no wheel has it; Cyclone DDS reads it in test_two_robots.py
        if slow:
            topics = {name: topics[name] for name in ("real_time_factor", "/diagnostics")}
        self.node = node
        self.messages = {name: [] for name in topics}
        self.subscriptions = [node.create_subscription(kind, own(name), self.messages[name].append, qos) for name, (kind, qos) in topics.items()]

    def __getitem__(self, name):
        return self.messages[name]

    def close(self):
        for subscription in self.subscriptions:
            self.node.destroy_subscription(subscription)


@pytest.fixture
def received(robot):
    """Time stands still: a thousand messages a second on each topic would be more than rclpy reads, and what it reads then is old."""
    robot.pause(True)
    received = Received(robot.client.node, "/faced")
    wait_until(lambda: received["robot_description"] and received["joint_states"], 20, "the robot")
    yield received
    received.close()


def step_for(robot, received, count):
    """So many steps, and as many again where messages were lost; returns the newest instant that every topic has, and its messages."""
    stamp = lambda message: round(1000 * seconds(message.clock if hasattr(message, "clock") else message.header.stamp))
    names = ["joint_states", "joint_command", "imu", "odom", "clock", *(f"ground_force/{leg}" for leg in LEGS)]
    for tries in range(1, 11):  # a busy machine may lose the one message of a topic that is sent best effort
        for _ in range(count):
            step(robot)
        time.sleep(0.5)  # nothing is on its way any more
        reported = {name: {stamp(message): message for message in list(received[name])} for name in names}
        if stamps := set.intersection(*map(set, reported.values())):
            return {"at": max(stamps), "steps": tries * count, **{name: messages[max(stamps)] for name, messages in reported.items()}}
    raise AssertionError(f"no instant that every topic has: { {name: len(received[name]) for name in names} }")


def step(robot):
    from std_srvs.srv import Trigger

    response = robot.client.call(robot.service(Trigger, "step"), Trigger.Request())
    assert response.success, response.message


def test_a_paused_robot_is_stepped_and_every_topic_has_the_same_instant(robot, received):
    """Time stands still; each step is one millisecond, and what is published then fits together."""
    from std_srvs.srv import Trigger

    (description,) = received["robot_description"]
    assert description.data.startswith("<") and "<robot" in description.data and all(f'"{joint}"' in description.data for joint in JOINTS)
    first = step_for(robot, received, 12)
    reported = step_for(robot, received, 10)
    # Odometry comes every fifth millisecond; ten steps on, it is ten milliseconds later.
    assert reported["at"] - first["at"] == reported["steps"] and first["at"] <= first["steps"] + 18
    assert len({seconds(message.header.stamp) for message in received["joint_states"]}) >= 20
    state, command, imu, odom = (reported[name] for name in ("joint_states", "joint_command", "imu", "odom"))
    assert list(state.name) == list(command.name) == JOINTS
    assert len(state.position) == len(state.velocity) == len(state.effort) == 12
    # Disarmed: the drives give nothing, and are asked for nothing.
    assert list(command.kp) == list(command.kd) == list(command.torque) == [0.0] * 12
    orientation = odom.pose.pose.orientation
    assert (imu.orientation, imu.header.frame_id) == (orientation, "left/imu_link")
    assert (odom.header.frame_id, odom.child_frame_id) == ("left/odom", "left/base_link")
    assert abs(math.hypot(orientation.x, orientation.y, orientation.z, orientation.w) - 1) < 1e-5
    if "/tf" in received.messages:
        (transform,) = received["/tf"][-1].transforms
        assert (transform.header.frame_id, transform.child_frame_id) == ("left/odom", "left/base_link")
    # A step while time runs is refused.
    robot.pause(False)
    response = robot.client.call(robot.service(Trigger, "step"), Trigger.Request())
    assert not response.success and "pause" in response.message, response


def test_a_standing_robot_weighs_what_it_weighs_and_a_push_moves_it(robot):
    from diagnostic_msgs.msg import DiagnosticArray
    from geometry_msgs.msg import WrenchStamped
    from rcl_interfaces.msg import Parameter, ParameterEvent, ParameterValue
    from rcl_interfaces.srv import SetParameters

    robot.pause(False)
    for request in ("arm", "stand"):
        robot.trigger(request)
    robot.wait(lambda: robot.mode() == "standing", 60, "standing")
    since = robot.time()
    robot.wait(lambda: robot.time() > since + 2.0, 30, "at rest")
    robot.pause(True)
    received = Received(robot.client.node, "/faced")
    wait_until(lambda: received["robot_description"] and received["joint_states"], 20, "the robot")
    reported = step_for(robot, received, 12)
    imu, forces = reported["imu"], [reported[f"ground_force/{leg}"].wrench.force for leg in LEGS]
    # It still settles a little.
    assert imu.linear_acceleration.z == pytest.approx(GRAVITY_M_S2, abs=0.6)
    masses = re.findall(r'<mass value="([0-9.eE+-]+)"', received["robot_description"][0].data)
    weight = GRAVITY_M_S2 * sum(map(float, masses))
    assert sum(force.z for force in forces) == pytest.approx(weight, rel=0.05) and all(force.z > 0.1 * weight for force in forces)
    state, command = reported["joint_states"], reported["joint_command"]
    torque = [
        kp * (target - position) + kd * (rate - velocity) + feed
        for kp, kd, target, rate, feed, position, velocity in zip(
            command.kp, command.kd, command.position, command.velocity, command.torque, state.position, state.velocity, strict=True
        )
    ]
    # The drives do what the command says of the state.
    assert list(state.effort) == pytest.approx(torque, abs=2.0), "effort is the law's torque"
    state = robot.states[-1]
    assert state.mode == "standing" and len(state.tracking_error_rad) == len(state.commanded_torque_nm) == 12 and state.cycles > 1000
    received.close()
    received = Received(robot.client.node, "/faced", slow=True)
    robot.pause(False)
    wait_until(lambda: received["real_time_factor"] and received["real_time_factor"][-1].data > 0, 10, "real_time_factor")
    names = lambda: {status.name for message in received["/diagnostics"] for status in message.status}
    loops = ("/faced/controller: control loop", "/faced/sim_bridge: simulation")
    wait_until(lambda: set(loops) <= names(), 10, lambda: f"{names()}")

    events = []
    robot.client.node.create_subscription(ParameterEvent, "/parameter_events", events.append, 10)
    publisher = robot.client.node.create_publisher(WrenchStamped, "/faced/push", 10)
    wait_until(lambda: publisher.get_subscription_count() == 1, 20, "push has a subscriber")
    set_ = robot.service(SetParameters, "sim_bridge/set_parameters")
    moved = {}
    for duration_s in (0.02, 0.1):
        changed = Parameter(name="push_duration_s", value=ParameterValue(type=3, double_value=duration_s))
        request = SetParameters.Request(parameters=[changed])
        reported = lambda d=duration_s: any(p.value.double_value == d for e in list(events) for p in e.changed_parameters)
        # The first event may be sent before the subscription of this moment is matched: then it is set once more.
        wait_until(lambda: robot.client.call(set_, request).results[0].successful and reported(), 20, "a parameter event")
        push = WrenchStamped()
        push.wrench.force.y = 150.0
        sideways = lambda: max((message.twist.twist.linear.y for message in list(robot.odometry)), default=0.0)
        robot.odometry.clear()
        for _ in range(10):
            publisher.publish(push)
            since = robot.time()
            robot.wait(lambda since=since: robot.time() > since + 1.0, 30, "the push is over")
            if sideways() > 0.01:
                break  # the very first may come before the bridge has matched its publisher
        moved[duration_s] = sideways()
    # How far a push moves it depends on what it did before; that it does is enough here.
    assert min(moved.values()) > 0.01, moved
    assert robot.mode() == "standing"

    # Once a second: of the control cycles, which follow the simulation here, and of the wall clock.
    diagnostics = lambda name: [status for message in list(received["/diagnostics"]) for status in message.status if status.name == name]
    came = []
    note = lambda message: came.append(time.monotonic()) if any(status.name == loops[1] for status in message.status) else None
    robot.client.node.create_subscription(DiagnosticArray, "/diagnostics", note, 10)
    wait_until(lambda: len(came) >= 4 and len(diagnostics(loops[0])) >= 4, 20, lambda: f"four diagnostics of each: {came}, {len(diagnostics(loops[0]))}")
    cycles = [int(next(value.value for value in status.values if value.key == "cycles")) for status in diagnostics(loops[0])]
    assert {after - before for before, after in itertools.pairwise(cycles)} == {1000}, cycles
    gaps = sorted(after - before for before, after in itertools.pairwise(came))
    assert gaps[len(gaps) // 2] == pytest.approx(1.0, abs=0.2), gaps
    received.close()


def test_the_ground_is_the_one_that_the_parameters_name(processes, client):
    """A robot without a controller, limp, on slippery ground, pushed forward for a second: it slides off, or not."""
    from geometry_msgs.msg import WrenchStamped
    from nav_msgs.msg import Odometry
    from sensor_msgs.msg import Imu
    from std_srvs.srv import SetBool

    grounds = {
        "flat": [],
        "slope": ["slope_uphill_deg:=-10.0"],
        "rough": ["bump_height_m:=0.2", "bump_cell_m:=0.2", "seed:=3"],
        "steps": ["stair_rise_m:=0.3"],
    }
    push = WrenchStamped()
    push.wrench.force.x = 150.0
    came, leaned, lay = {}, {}, {}
    for terrain, parameters in grounds.items():
        namespace = f"/ground_{terrain}"
        common = [f"terrain:={terrain}", "friction:=0.05", "push_duration_s:=1.0", "start_paused:=true", "mode:=realtime"]
        bridge = start(processes, "sim_bridge", namespace, *common, *parameters)
        odometry, attitude = [], []
        client.node.create_subscription(Odometry, f"{namespace}/odom", odometry.append, best_effort(1))
        client.node.create_subscription(Imu, f"{namespace}/imu", attitude.append, best_effort(1))
        publisher = client.node.create_publisher(WrenchStamped, f"{namespace}/push", 10)
        pause = client.service(SetBool, f"{namespace}/pause")
        wait_until(lambda: publisher.get_subscription_count() == 1, 20, "push has a subscriber")
        assert client.call(pause, SetBool.Request(data=False)).success
        now = lambda odometry=odometry: seconds(odometry[-1].header.stamp) if odometry else 0.0
        wait_until(lambda: now() > 1.0 and attitude, 30, "it lies")
        q, lay[terrain] = attitude[-1].orientation, odometry[-1].pose.pose.position.z
        leaned[terrain] = math.degrees(math.asin(2 * (q.w * q.y - q.z * q.x)))
        publisher.publish(push)
        since = now()
        wait_until(lambda: now() > since + 2.0, 30, "the push is over")
        came[terrain] = odometry[-1].pose.pose.position.x
        assert bridge.stop() == 0, bridge.text()
    reported = f"came m {came}, pitch deg {leaned}, height m {lay}"
    print(reported)
    assert abs(leaned["flat"]) < 1 and leaned["slope"] == pytest.approx(10, abs=2), reported
    assert abs(lay["rough"] - lay["flat"]) > 0.02 and abs(lay["steps"] - lay["flat"]) < 0.005, reported
    # The first stair, as high as a wall, stands a metre in front of the origin.
    assert came["flat"] > 1.2 and came["slope"] > came["flat"] + 0.3 and came["steps"] < 1.0, reported


def test_a_gait_file_is_loaded_walked_recorded_and_stopped_by_either_emergency_stop(robot, tmp_path):
    from std_msgs.msg import Bool
    from std_srvs.srv import SetBool, Trigger
    from tandem_msgs.srv import ClearFault, LoadGait, StartRecording, StopRecording

    call = lambda kind, service, **fields: robot.client.call(robot.service(kind, service), kind.Request(**fields))
    refused = call(Trigger, "walk")
    assert not refused.success and "gait" in refused.message, refused
    file = tmp_path / "gait3.json"
    subprocess.run([TARGET / "tandem", "plan", "gait3", "-o", file], check=True, capture_output=True, cwd=ROOT)
    assert call(LoadGait, "load_gait", json=file.read_text()).success
    robot.wait(lambda: robot.states[-1].gait == "gait3", 10, "the gait's name in controller_state")
    began = call(StartRecording, "start_recording", folder="run")
    assert began.success, began.message
    assert not call(StartRecording, "start_recording", folder="another").success
    robot.trigger("walk")
    robot.wait(lambda: robot.mode() == "walking" and robot.states[-1].step_index >= 3, 60, "some steps")
    phases = [state.step_phase for state in robot.states if state.mode == "walking"]
    assert max(phases) > 0.5 and all(0 <= phase <= 1 for phase in phases)
    robot.trigger("stop")
    robot.wait(lambda: robot.mode() == "standing", 60, "standing")
    ended = call(StopRecording, "stop_recording")
    assert ended.success and ended.messages > 1000 and ended.bytes > 10000 and ended.dropped == 0, ended
    assert ended.folder == str(RECORDINGS / "run") and (RECORDINGS / "run/metadata.yaml").exists()
    assert not call(StopRecording, "stop_recording").success

    publisher = robot.client.node.create_publisher(Bool, "/faced/emergency_stop", 1)
    wait_until(lambda: publisher.get_subscription_count() == 1, 20, "emergency_stop has a subscriber")
    by_topic = lambda pressed: publisher.publish(Bool(data=pressed))
    by_service = lambda pressed: call(SetBool, "emergency_stop", data=pressed)
    time.sleep(0.5)
    for press in (by_topic, by_service):
        press(True)
        wait_until(lambda: robot.mode() == "damping" and robot.states[-1].fault == "emergency_stop", 20, lambda: f"{robot.states[-1]}")
        refused = call(Trigger, "stand")
        assert not refused.success and "emergency" in refused.message, refused
        # Released, it stays damped until someone asks for more.
        press(False)
        since = len(robot.states)
        wait_until(lambda: len(robot.states) > since + 20, 20, "controller_state goes on")
        assert robot.mode() == "damping"
        if press is by_topic:
            # Refused while it still sinks.
            wait_until(lambda: call(Trigger, "stand").success, 30, lambda: f"{robot.states[-1]}")
            wait_until(lambda: robot.mode() == "standing", 60, lambda: f"{robot.states[-1]}")
    robot.trigger("disarm")
    wait_until(lambda: robot.mode() == "disarmed", 20, lambda: f"{robot.states[-1]}")
    none = call(ClearFault, "clear_fault", name="tilt")
    assert not none.success and "not latched" in none.message, none
    wait_until(lambda: call(Trigger, "arm").success, 30, "it is at rest and armed")
    wait_until(lambda: robot.mode() == "damping", 20, lambda: f"{robot.states[-1]}")
    robot.trigger("disarm")
    wait_until(lambda: robot.mode() == "disarmed", 20, lambda: f"{robot.states[-1]}")


def test_a_controller_alone_receives_every_topic_that_it_subscribes_to(client, processes, tmp_path):
    """Stand-ins for the robot: what is published on its inputs is seen in what it publishes."""
    from builtin_interfaces.msg import Time
    from geometry_msgs.msg import WrenchStamped
    from nav_msgs.msg import Odometry
    from sensor_msgs.msg import Imu, JointState
    from tandem_msgs.msg import ControllerState, JointCommand
    from tandem_msgs.srv import StartRecording, StopRecording
    from std_srvs.srv import Trigger

    process = start(processes, "controller", "/alone", "mode:=lockstep", "tilt_limit_rad:=0.5", f"record_root:={tmp_path / 'recordings'}")
    commands, states = [], []
    client.node.create_subscription(JointCommand, "/alone/joint_command", commands.append, 10)
    client.node.create_subscription(ControllerState, "/alone/controller_state", states.append, 10)
    kinds = {"joint_states": JointState, "imu": Imu, "odom": Odometry, **{f"ground_force/{leg}": WrenchStamped for leg in LEGS}}
    publishers = {name: client.node.create_publisher(kind, f"/alone/{name}", 10) for name, kind in kinds.items()}
    wait_until(lambda: all(publisher.get_subscription_count() == 1 for publisher in publishers.values()), 30, "it subscribes to all")
    stamp = lambda cycle: Time(sec=cycle // 1000, nanosec=cycle % 1000 * 1_000_000)
    assert client.call(client.service(StartRecording, "/alone/start_recording"), StartRecording.Request(folder="alone")).success
    cycle = 0

    def say(count, **tilt):
        nonlocal cycle
        for _ in range(count):
            cycle += 1
            orientation = Imu()
            orientation.header.stamp = stamp(cycle)
            orientation.orientation.x, orientation.orientation.w = math.sin(tilt.get("roll", 0) / 2), math.cos(tilt.get("roll", 0) / 2)
            publishers["imu"].publish(orientation)
            odometry = Odometry()
            odometry.header.stamp, odometry.pose.pose.position.x = stamp(cycle), 0.5 * cycle
            publishers["odom"].publish(odometry)
            for leg in LEGS:
                force = WrenchStamped()
                force.header.stamp, force.wrench.force.z = stamp(cycle), 100.0
                publishers[f"ground_force/{leg}"].publish(force)
            # In another order: it is the names that count.
            message = JointState(name=JOINTS[::-1], position=[0.01 * j for j in range(12)][::-1], velocity=[0.0] * 12, effort=[0.0] * 12)
            message.header.stamp = stamp(cycle)
            publishers["joint_states"].publish(message)
            wait_until(lambda: commands and commands[-1].header.stamp == stamp(cycle), 10, f"the answer to {cycle}")

    say(30)
    assert client.call(client.service(Trigger, "/alone/arm"), Trigger.Request()).success
    say(40)
    wait_until(lambda: states[-1].mode == "damping", 10, lambda: f"{states[-1:]}")
    assert all(gain > 0 for gain in commands[-1].kd) and list(commands[-1].kp) == [0.0] * 12
    say(60, roll=0.7)
    wait_until(lambda: "tilt" in states[-1].fault, 10, lambda: f"{states[-1:]}")
    ended = client.call(client.service(StopRecording, "/alone/stop_recording"), StopRecording.Request())
    assert ended.success, ended.message
    listed = subprocess.run([TARGET / "tandem", "bag", "info", tmp_path / "recordings/alone"], check=True, capture_output=True, text=True, cwd=ROOT).stdout
    for name in kinds:
        assert re.search(rf"^ +/{name} +[1-9]", listed, re.MULTILINE), f"{name} was recorded: {listed}"
    assert process.stop() == 0, process.text()


def test_every_row_of_the_tables_is_exercised():
    """A name that is new in docs/interfaces.md needs its place in a test: it must stand in the text of one."""
    text = "".join(file.read_text() for file in (ROOT / "tests/ros2").glob("test_*.py") if file.name != "test_interfaces.py")
    document = (ROOT / "docs/interfaces.md").read_text()
    for node in NODES:
        section = document.split(f"(`{node}`)\n", 1)[1].split("\n## ", 1)[0]
        for line in section.splitlines():
            cells = [cell.strip() for cell in line.strip("|").split("|")]
            if len(cells) == 4 and cells[0] in ("publisher", "subscription", "service", "action"):
                for name in re.findall(r"`([^`]+)`", cells[1]):
                    assert re.search(rf'["/]{re.escape(name.split("/")[-1])}["/]', text), f"{node}: {name} is in no test"
