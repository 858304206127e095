"""Topics against Cyclone DDS, another implementation of the wire protocol, both ways. Its types are made from rclpy's."""

import importlib
import random
import time

import pytest
from conftest import DOMAIN, wait_until
from test_serialization import random_message

# This machine's loopback, as the nodes under test.
CONFIGURATION = """<CycloneDDS><Domain><General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>
<AllowMulticast>false</AllowMulticast></General><Discovery><Peers><Peer address="127.0.0.1"/></Peers>
<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>60</MaxAutoParticipantIndex></Discovery></Domain></CycloneDDS>"""

STRUCTS = {}
WITHOUT_WHEEL = {"tf2_msgs/msg/TFMessage": {"transforms": "sequence<geometry_msgs/TransformStamped>"}}


def struct_of(name):
    """The Cyclone class of `package/msg/Name`."""
    import cyclonedds.idl.types as idl
    from cyclonedds.idl import make_idl_struct

    if name in STRUCTS:
        return STRUCTS[name]
    package, _, short = name.split("/")
    if name in WITHOUT_WHEEL:
        described = WITHOUT_WHEEL[name]
    else:
        described = getattr(importlib.import_module(f"{package}.msg"), short).get_fields_and_field_types()

    def type_of(text):
        if text.startswith("sequence<"):
            inner, _, bound = text[len("sequence<") : -1].partition(", ")
            return idl.sequence[type_of(inner), int(bound)] if bound else idl.sequence[type_of(inner)]
        if text.endswith("]"):
            inner, _, length = text[:-1].partition("[")
            return idl.array[type_of(inner), int(length)]
        if "/" in text:
            inner_package, inner = text.split("/")
            return struct_of(f"{inner_package}/msg/{inner}")
        plain = {"string": str, "boolean": bool, "double": idl.float64, "float": idl.float32, "octet": idl.byte}
        return plain[text] if text in plain else getattr(idl, text)

    fields = {field: type_of(text) for field, text in described.items()}
    STRUCTS[name] = make_idl_struct(short + "_", f"{package}.msg.dds_.{short}_", fields)
    return STRUCTS[name]


def to_cyclone(message):
    """A message of rclpy as one of Cyclone."""
    kind = type(message)
    if not hasattr(kind, "get_fields_and_field_types"):
        if isinstance(message, bytes):
            return message[0]
        return [to_cyclone(item) for item in message] if not isinstance(message, (str, int, float, bool)) else message
    package, name = kind.__module__.split(".")[0], kind.__name__
    fields = {field: to_cyclone(getattr(message, field)) for field in kind.get_fields_and_field_types()}
    return struct_of(f"{package}/msg/{name}")(**fields)


class Cyclone:
    """A participant of Cyclone DDS."""

    def __init__(self):
        from cyclonedds.domain import Domain, DomainParticipant
        from cyclonedds.qos import Policy, Qos
        from cyclonedds.util import duration

        self.domain = Domain(DOMAIN, CONFIGURATION)
        self.participant = DomainParticipant(DOMAIN)
        reliable = Policy.Reliability.Reliable(duration(seconds=1))
        final = Policy.TypeConsistency.DisallowTypeCoercion()
        self.qos = {
            "reliable": Qos(reliable, Policy.History.KeepLast(100), final),
            "best_effort": Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(100), final),
            "latched": Qos(reliable, Policy.History.KeepLast(1), Policy.Durability.TransientLocal, final),
        }

    def topic(self, name, type_):
        from cyclonedds.topic import Topic

        return Topic(self.participant, "rt" + name, struct_of(type_))

    def writer(self, name, type_, qos="reliable"):
        from cyclonedds.pub import DataWriter

        return DataWriter(self.participant, self.topic(name, type_), qos=self.qos[qos])

    def reader(self, name, type_, qos="reliable"):
        from cyclonedds.sub import DataReader

        return DataReader(self.participant, self.topic(name, type_), qos=self.qos[qos])


@pytest.fixture(scope="module")
def cyclone():
    return Cyclone()


@pytest.fixture(scope="module")
def exercise(processes):
    process = processes("examples/exercise", "--ros-args", "-r", "__ns:=/cyclone", name="exercise-cyclone")
    wait_until(lambda: "ready" in process.text(), 20, "exercise is ready")
    return process


@pytest.mark.parametrize(
    "type_, there, back, qos",
    [
        ("tandem_msgs/msg/Gait", "/cyclone/input", "/cyclone/output", "reliable"),
        ("sensor_msgs/msg/JointState", "/cyclone/fast_input", "/cyclone/fast_output", "best_effort"),
    ],
)
def test_messages_come_back_from_our_node_as_cyclone_sent_them(cyclone, exercise, type_, there, back, qos):
    package, _, name = type_.split("/")
    rclpy_type = getattr(importlib.import_module(f"{package}.msg"), name)
    reader, writer = cyclone.reader(back, type_, qos), cyclone.writer(there, type_, qos)
    wait_until(lambda: writer.get_matched_subscriptions() and reader.get_matched_publications(), 20, "both ends are matched")
    time.sleep(0.5)
    source = random.Random(5)
    sent, got = [], []
    for _ in range(50):
        sent.append(to_cyclone(random_message(rclpy_type, source)))
        writer.write(sent[-1])
        time.sleep(0.01)
        got += reader.take(100)
    wait_until(lambda: got.extend(reader.take(100)) or len(got) >= (50 if qos == "reliable" else 45), 10, lambda: f"{len(got)} of 50 came back")
    assert got == sent if qos == "reliable" else all(message in sent for message in got)


def test_a_gait_that_was_planned_before_reaches_cyclone_and_a_controller_answers_its_joint_states(cyclone, client, processes):
    from sensor_msgs.msg import JointState
    from tandem_msgs.srv import GenerateGait
    from test_walk import JOINTS

    processes("tandem_planner", "--ros-args", "-r", "__ns:=/cyclone")
    controller = processes("tandem_controller", "--ros-args", "-r", "__ns:=/cyclone")
    plan = client.service(GenerateGait, "/cyclone/generate_gait")
    response = client.call(plan, GenerateGait.Request(behaviour="amble"))
    assert response.success
    reader = cyclone.reader("/cyclone/gait", "tandem_msgs/msg/Gait", "latched")
    (gait,) = wait_until(lambda: reader.take(1), 20, "the latched gait")
    assert (gait.name, list(gait.joint_names), gait.step_length_m) == ("amble", JOINTS, response.step_length_m)
    assert len(gait.coefficients_rad) == 72 and gait.solver.status == "converged"

    # Cyclone plays the robot.
    commands = cyclone.reader("/cyclone/joint_command", "tandem_msgs/msg/JointCommand", "best_effort")
    states = cyclone.writer("/cyclone/joint_states", "sensor_msgs/msg/JointState", "best_effort")
    wait_until(lambda: states.get_matched_subscriptions() and commands.get_matched_publications(), 20, "both ends are matched")
    time.sleep(0.5)
    stamps, answered = set(), []
    for cycle in range(200):
        state = JointState(name=JOINTS, position=[0.1, 1.0, 2.0] * 4, velocity=[0.0] * 12, effort=[0.0] * 12)
        state.header.stamp.nanosec = 5_000_000 * (cycle + 1) % 1_000_000_000
        state.header.stamp.sec = 1 + 5 * (cycle + 1) // 1000
        stamps.add((state.header.stamp.sec, state.header.stamp.nanosec))
        states.write(to_cyclone(state))
        time.sleep(0.005)
        answered += commands.take(100)
    assert len(answered) > 100, f"{len(answered)} commands for 200 states"
    for command in answered:
        assert (command.header.stamp.sec, command.header.stamp.nanosec) in stamps
        assert list(command.name) == JOINTS and list(command.kp) == [0.0] * 12, "it is disarmed"
    assert controller.alive()
