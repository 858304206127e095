"""The crate `ros` against real rclpy: topics, services, parameters, the graph, both ways."""

import threading
import time

import pytest
from conftest import wait_until


@pytest.fixture(scope="module")
def exercise(processes, ros):
    process = processes(
        "examples/exercise", "--ros-args", "-r", "__ns:=/robot", "-p", "gain:=2.5", "-p", "nobody:=1", "-r", "generate:=plan", name="exercise"
    )
    wait_until(lambda: "ready" in process.text() or not process.alive(), 20, "exercise is ready")
    assert process.alive(), process.text()
    return process


def reliable(depth=10):
    from rclpy.qos import QoSProfile, ReliabilityPolicy

    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE)


def best_effort():
    from rclpy.qos import QoSProfile, ReliabilityPolicy

    return QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)


def a_gait():
    from tandem_msgs.msg import Gait

    gait = Gait()
    gait.header.stamp.sec = -3
    gait.header.stamp.nanosec = 7
    gait.header.frame_id = "odom"
    gait.version = 1
    gait.robot = "vision60"
    gait.name = "Trab, gemächlich"
    gait.joint_names = [f"joint_{i}" for i in range(12)]
    gait.step_duration_s = 0.25
    gait.bezier_degree = 5
    gait.coefficients_rad = [i / 7 for i in range(72)]
    gait.mirror_leg = [2, 3, 0, 1]
    gait.mirror_sign = [-1.0, 1.0, 1.0]
    gait.initial_base_pose.position.z = 0.55
    gait.initial_base_pose.orientation.w = 1.0
    gait.initial_base_twist.angular.y = -0.1
    gait.kp = [230.0, 230.0, 300.0] * 4
    gait.request_json = '{"behaviour": "amble"}'
    gait.solver.status = "converged"
    gait.solver.iterations = 12
    gait.solver.objective = 0.0537
    gait.solver.worst_constraint = "touchdown"
    return gait


def test_a_reliable_message_comes_back_as_it_went(client, exercise):
    from tandem_msgs.msg import Gait

    received = []
    client.node.create_subscription(Gait, "/robot/output", received.append, reliable(100))
    publisher = client.node.create_publisher(Gait, "/robot/input", reliable(100))
    wait_until(lambda: publisher.get_subscription_count() == 1, 20, "our subscription is seen")
    wait_until(lambda: client.node.count_publishers("/robot/output") == 1, 20, "our publisher is seen")
    time.sleep(0.5)
    sent = a_gait()
    for index in range(20):
        sent.version = index
        publisher.publish(sent)
    wait_until(lambda: len(received) == 20, 10, lambda: f"20 messages come back, got {[m.version for m in received]}")
    assert [message.version for message in received] == list(range(20))
    assert received[-1] == sent


def test_best_effort_at_500_hz_loses_next_to_nothing(client, exercise):
    from sensor_msgs.msg import JointState

    received = []
    client.node.create_subscription(JointState, "/robot/fast_output", lambda m: received.append(m.position[0]), best_effort())
    publisher = client.node.create_publisher(JointState, "/robot/fast_input", best_effort())
    wait_until(lambda: publisher.get_subscription_count() == 1, 20, "our subscription is seen")
    wait_until(lambda: client.node.count_publishers("/robot/fast_output") == 1, 20, "our publisher is seen")
    time.sleep(0.5)
    message = JointState(name=[f"joint_{i}" for i in range(12)], position=[0.0] * 12)
    for index in range(500):
        message.position[0] = float(index)
        publisher.publish(message)
        time.sleep(0.002)
    time.sleep(0.5)
    assert received == sorted(received)
    assert len(received) > 400, f"only {len(received)} of 500 came back"


def test_a_latched_message_reaches_who_comes_late(client, exercise):
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
    from std_msgs.msg import String

    received = []
    qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    client.node.create_subscription(String, "/robot/description", received.append, qos)
    wait_until(lambda: received, 10, "the latched message")
    assert received[0].data == "a robot"


def test_a_remapped_service_answers_with_every_field(client, exercise):
    from tandem_msgs.srv import GenerateGait

    plan = client.service(GenerateGait, "/robot/plan")
    response = client.call(plan, GenerateGait.Request(behaviour="amble", speed_m_s=[0.35]))
    assert (response.success, response.status, response.message) == (True, "amble", "[0.35]")
    assert (response.step_duration_s, response.solver.iterations) == (0.25, 7)


def test_a_hundred_calls_in_a_row_lose_no_response(client, exercise):
    from std_srvs.srv import SetBool

    count = client.service(SetBool, "/robot/count")
    first = int(client.call(count, SetBool.Request(data=True)).message)
    for index in range(1, 101):
        assert int(client.call(count, SetBool.Request(data=True)).message) == first + index


def test_four_clients_at_once_are_all_answered(client, exercise):
    from std_srvs.srv import SetBool

    numbers = []

    def caller(count):
        numbers.extend(int(client.call(count, SetBool.Request(data=True)).message) for _ in range(25))

    threads = [threading.Thread(target=caller, args=[client.service(SetBool, "/robot/count")]) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(numbers) == list(range(min(numbers), min(numbers) + 100)), "each request handled and answered once"


def test_our_client_calls_a_service_of_rclpy(client, exercise):
    from std_srvs.srv import SetBool, Trigger

    def answer(request, response):
        response.success = request.data
        response.message = "from rclpy"
        return response

    client.node.create_service(SetBool, "/robot/remote", answer)
    relay = client.service(Trigger, "/robot/relay")
    for _ in range(5):
        response = client.call(relay, Trigger.Request())
        assert (response.success, response.message) == (True, "from rclpy")


def test_parameters_are_listed_described_read_and_set(client, exercise):
    from rcl_interfaces.msg import ParameterEvent, ParameterType
    from rclpy.parameter import Parameter
    from rclpy.parameter_client import AsyncParameterClient

    events = []
    client.node.create_subscription(ParameterEvent, "/parameter_events", events.append, reliable(100))
    parameters = AsyncParameterClient(client.node, "/robot/exercise")
    assert parameters.wait_for_services(20)
    time.sleep(0.3)

    def result(future):
        wait_until(future.done, 20, "response")
        return future.result()

    listed = result(parameters.list_parameters()).result
    assert set(listed.names) == {"delay_ms", "fixed", "gain", "group.names", "use_sim_time"}
    assert list(listed.prefixes) == ["group"]
    gain, names, unknown = result(parameters.get_parameters(["gain", "group.names", "nothing"])).values
    assert (gain.type, gain.double_value) == (ParameterType.PARAMETER_DOUBLE, 2.5), "the command line wins over the default"
    assert list(names.string_array_value) == ["a"]
    assert unknown.type == ParameterType.PARAMETER_NOT_SET
    (description,) = result(parameters.describe_parameters(["gain"])).descriptors
    assert description.description == "A number."
    assert (description.floating_point_range[0].from_value, description.floating_point_range[0].to_value) == (0.0, 10.0)
    assert description.additional_constraints == "not 7"

    def set_(*values):
        return result(parameters.set_parameters([Parameter(name, value=value) for name, value in values])).results

    assert set_(("gain", 3.0))[0].successful
    for name, value, reason in [
        ("gain", 11.0, "from 0 to 10"),
        ("gain", float("nan"), "NaN"),
        ("gain", 7.0, "7 is taken"),
        ("gain", 3, "expected double, got integer 3; write 3.0"),
        ("fixed", "else", "read-only"),
        ("nothing", 1.0, "not declared"),
    ]:
        (refused,) = set_((name, value))
        assert not refused.successful and reason in refused.reason, (name, value, refused.reason)
    atomically = parameters.set_parameters_atomically([Parameter("gain", value=4.0), Parameter("fixed", value="else")])
    assert not result(atomically).result.successful
    assert result(parameters.get_parameters(["gain"])).values[0].double_value == 3.0
    wait_until(
        lambda: any(p.name == "gain" and p.value.double_value == 3.0 for e in events for p in e.changed_parameters),
        5,
        "the change on /parameter_events",
    )
    assert {event.node for event in events} == {"/robot/exercise"}


def test_the_graph_shows_names_and_types(client, exercise):
    wait_until(lambda: ("exercise", "/robot") in client.node.get_node_names_and_namespaces(), 10, "the node's name")
    topics = wait_until(
        lambda: dict(client.node.get_publisher_names_and_types_by_node("exercise", "/robot")), 10, "its publishers"
    )
    assert topics["/robot/output"] == ["tandem_msgs/msg/Gait"]
    services = dict(client.node.get_service_names_and_types_by_node("exercise", "/robot"))
    assert services["/robot/plan"] == ["tandem_msgs/srv/GenerateGait"]


def test_log_lines_reach_rosout(client, exercise):
    from rcl_interfaces.msg import Log
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

    lines = []
    qos = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    client.node.create_subscription(Log, "/rosout", lines.append, qos)
    ours = wait_until(lambda: [line for line in lines if line.name == "robot.exercise"], 10, "a line of ours")
    wait_until(lambda: any(line.msg == "ready" and line.level == 20 and line.stamp.sec > 0 for line in lines), 5, lambda: f"INFO: {lines}")
    warned = lambda: [line for line in lines if line.name == "robot.exercise" and 'parameter "nobody" was given' in line.msg]
    wait_until(warned, 5, lambda: f"the warning: {lines}")
    assert {line.level for line in warned()} == {30}
    assert all(line.level >= 20 for line in ours), "no debug lines unless they are asked for"


def test_every_severity_reaches_rosout(client, processes):
    from rcl_interfaces.msg import Log
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
    from std_srvs.srv import SetBool

    lines = []
    qos = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    subscription = client.node.create_subscription(Log, "/rosout", lines.append, qos)
    talker = processes("examples/exercise", "--ros-args", "-r", "__node:=talker", "--log-level", "debug", name="talker")
    service = client.service(SetBool, "/count")
    for data in (True, False):
        assert client.call(service, SetBool.Request(data=data)).success == data
    lines_of_talker = lambda: {(line.level, line.msg) for line in list(lines) if line.name == "talker" and line.msg.startswith("call")}
    expected = {(10, "call 1"), (10, "call 2"), (40, "call 2 failed, as it was asked to")}
    wait_until(lambda: lines_of_talker() == expected, 10, lambda: f"{expected}, received {lines_of_talker()}")
    client.node.destroy_subscription(subscription)
    talker.stop()


def test_a_publisher_of_another_type_is_dropped_and_named(client, exercise, processes):
    """Fast DDS does not match other types; our middleware does, and what arrives decodes as garbage."""
    from tandem_msgs.msg import Gait

    received = []
    client.node.create_subscription(Gait, "/robot/output", received.append, reliable())
    intruder = processes("examples/exercise", "--ros-args", "-r", "__node:=intruder", "-r", "description:=/robot/input", name="intruder")
    wait_until(lambda: "ready" in intruder.text(), 20, "the intruder is ready")
    wait_until(
        lambda: "/robot/input: a publisher sends std_msgs::msg::dds_::String_, expected tandem_msgs::msg::dds_::Gait_" in exercise.text()
        or "/robot/input: 1 messages could not be read" in exercise.text(),
        10,
        lambda: f"a warning in {exercise.text()}",
    )
    assert exercise.alive()
    assert not received
    intruder.stop()


def test_a_killed_subscriber_does_not_stop_the_publisher(client, exercise, processes):
    """As after SIGKILL of a reader: the writer's other readers go on."""
    import signal

    from tandem_msgs.msg import Gait

    other = processes("examples/exercise", "--ros-args", "-r", "__node:=victim", "-r", "input:=/robot/output", name="victim")
    wait_until(lambda: "ready" in other.text(), 20, "the victim is ready")
    received = []
    client.node.create_subscription(Gait, "/robot/output", lambda m: received.append(m.version), reliable(300))
    publisher = client.node.create_publisher(Gait, "/robot/input", reliable(300))
    wait_until(lambda: client.node.count_subscribers("/robot/output") >= 3, 20, "the victim's subscription")
    time.sleep(1)
    other.stop(signal.SIGKILL)
    message = a_gait()
    for index in range(200):
        message.version = index
        publisher.publish(message)
        time.sleep(0.002)
    wait_until(lambda: len(received) == 200, 10, lambda: f"200 messages, got {len(received)}: {received}")
    assert received == list(range(200))


def test_a_signal_that_comes_twice_at_once_is_one_wish(processes):
    """A terminal signals the whole process group, and a launch system signals its nodes once more."""
    import signal

    process = processes("tandem_controller", "--ros-args", "-r", "__ns:=/twice")
    wait_until(lambda: "disarmed" in process.text(), 20, "it is up")
    process.process.send_signal(signal.SIGINT)
    time.sleep(0.05)
    assert process.stop() == 0, process.text()


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_signal_ends_a_node_at_once_and_others_see_it_leave(client, processes, name):
    import signal

    process = processes("examples/exercise", "--ros-args", "-r", f"__node:=leaver_{name.lower()}", name=name)
    seen = lambda: f"leaver_{name.lower()}" in client.node.get_node_names()
    wait_until(seen, 20, "the node is seen")
    began = time.monotonic()
    assert process.stop(getattr(signal, name)) == 0, process.text()
    assert time.monotonic() - began < 3
    wait_until(lambda: not seen(), 5, "the node is gone from the graph")
