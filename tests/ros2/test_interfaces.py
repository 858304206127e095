"""docs/interfaces.md against the running nodes: every topic, service and action, and every parameter's table."""

import json
import os
import pathlib
import re
import sys
import time

import pytest
from conftest import ROOT, wait_until

DOCUMENT = ROOT / "docs/interfaces.md"
NODES = ["planner", "controller", "sim_bridge"]
# What every node has, stated once in the document's text.
COMMON_TOPICS = {"/rosout", "/parameter_events", "/clock"}
# Stated once as well: below the node's own name.
COMMON = {
    ("publisher", "transition_event"): "lifecycle_msgs/msg/TransitionEvent",
    ("service", "change_state"): "lifecycle_msgs/srv/ChangeState",
    ("service", "get_state"): "lifecycle_msgs/srv/GetState",
    ("service", "get_available_states"): "lifecycle_msgs/srv/GetAvailableStates",
    ("service", "get_available_transitions"): "lifecycle_msgs/srv/GetAvailableTransitions",
    ("service", "get_transition_graph"): "lifecycle_msgs/srv/GetAvailableTransitions",
    ("service", "describe_parameters"): "rcl_interfaces/srv/DescribeParameters",
    ("service", "get_parameter_types"): "rcl_interfaces/srv/GetParameterTypes",
    ("service", "get_parameters"): "rcl_interfaces/srv/GetParameters",
    ("service", "list_parameters"): "rcl_interfaces/srv/ListParameters",
    ("service", "set_parameters"): "rcl_interfaces/srv/SetParameters",
    ("service", "set_parameters_atomically"): "rcl_interfaces/srv/SetParametersAtomically",
}


@pytest.fixture(scope="module")
def running(processes, client):
    started = {name: processes(f"tandem_{name}", "--ros-args", "-r", "__ns:=/faces", name=name) for name in NODES}

    def seen():
        for process in started.values():
            assert process.alive(), process.text()
        names = {name for name, namespace in client.node.get_node_names_and_namespaces() if namespace == "/faces"}
        return set(NODES) <= names

    wait_until(seen, 30, "the three nodes are seen")
    time.sleep(2)  # their endpoints follow
    yield started
    for process in started.values():
        assert process.stop() == 0, process.text()


def documented(node):
    """Rows of the node's table: {(kind, full name): type}."""
    text = DOCUMENT.read_text()
    section = text.split(f"(`{node}`)\n", 1)[1].split("\n## ", 1)[0]
    rows = {}
    for line in section.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 4 and cells[0] in ("publisher", "subscription", "service", "action"):
            for name in re.findall(r"`([^`]+)`", cells[1]):
                rows[(cells[0], name if name.startswith("/") else f"/faces/{name}")] = cells[2]
    rows.update({(kind, f"/faces/{node}/{name}"): type_ for (kind, name), type_ in COMMON.items()})
    assert all(f"`~/{name}`" in text for _, name in COMMON), "the text names what every node has"
    return rows


def actual(client, node):
    rows = {}
    # /clock is subscribed to by the middleware's own helper under another type.
    for name, types in client.node.get_publisher_names_and_types_by_node(node, "/faces"):
        if name == "/clock" or name not in COMMON_TOPICS:
            rows[("publisher", name)] = types[0]
    for name, types in client.node.get_subscriber_names_and_types_by_node(node, "/faces"):
        if name not in COMMON_TOPICS and name != "/ros_discovery_info":
            rows[("subscription", name)] = types[0]
    for name, types in client.node.get_service_names_and_types_by_node(node, "/faces"):
        rows[("service", name)] = types[0]
    folded = {}
    for (kind, name), type_ in rows.items():
        action, _, rest = name.partition("/_action/")
        if rest:
            if rest == "feedback":
                folded[("action", action)] = type_.removesuffix("_FeedbackMessage")
        else:
            folded[(kind, name)] = type_
    return folded


@pytest.mark.parametrize("node", NODES)
def test_the_tables_of_interfaces_are_those_of_the_nodes(client, running, node):
    wait_until(lambda: actual(client, node).keys() >= documented(node).keys(), 10, lambda: f"{actual(client, node)}")
    assert actual(client, node) == documented(node)


def hash_of(dds_name):
    """What ROS 2's own generator wrote for a type that DDS knows by this name."""
    package, kind, name = re.fullmatch(r"(\w+)::(\w+)::dds_::(\w+)_", dds_name).groups()
    whole = re.sub(r"_(SendGoal|GetResult|FeedbackMessage|Request|Response).*", "", name)
    file = pathlib.Path(sys.prefix) / f"share/{package}/{kind}/{whole}.json"
    hashes = {entry["type_name"]: entry["hash_string"] for entry in json.loads(file.read_text())["type_hashes"]}
    return hashes[f"{package}/{kind}/{name}"]


def test_every_endpoint_announces_the_hash_of_its_type(client, running):
    wait_until(lambda: all(actual(client, node).keys() >= documented(node).keys() for node in NODES), 20, "all endpoints are seen")
    seen, wrong = set(), set()
    for topic, _ in client.node.get_topic_names_and_types(no_demangle=True):
        publishers = client.node.get_publishers_info_by_topic(topic, no_mangle=True)
        for endpoint in publishers + client.node.get_subscriptions_info_by_topic(topic, no_mangle=True):
            seen.add(endpoint.topic_type)
            # tf2_msgs has no wheel.
            if endpoint.topic_type != "tf2_msgs::msg::dds_::TFMessage_" and str(endpoint.topic_type_hash) != hash_of(endpoint.topic_type):
                wrong.add((endpoint.node_name, topic, endpoint.topic_type, str(endpoint.topic_type_hash)))
    print("\n".join(map(str, wrong)))
    assert not wrong
    # Ours, standard ones, services, the action and the graph's own topic are among them.
    of_interest = ["msg::dds_::ControllerState", "srv::dds_::GenerateGait_Request", "action::dds_::GenerateGait_FeedbackMessage"]
    assert {f"tandem_msgs::{name}_" for name in of_interest} <= seen, seen
    assert {"sensor_msgs::msg::dds_::Imu_", "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_"} <= seen, seen
    # What ros2 topic info --verbose asks for.
    [controller] = client.node.get_publishers_info_by_topic("/faces/controller_state")
    assert str(controller.topic_type_hash) == hash_of("tandem_msgs::msg::dds_::ControllerState_")


def parameter_table(client, node):
    from rcl_interfaces.msg import ParameterType
    from rclpy.parameter import parameter_value_to_python
    from rclpy.parameter_client import AsyncParameterClient

    parameters = AsyncParameterClient(client.node, f"/faces/{node}")
    assert parameters.wait_for_services(60)
    time.sleep(0.2)

    def result(future):
        wait_until(future.done, 20, "response")
        return future.result()

    names = sorted(set(result(parameters.list_parameters()).result.names) - {"use_sim_time"})
    values = result(parameters.get_parameters(names)).values
    descriptors = result(parameters.describe_parameters(names)).descriptors
    types = {v: k.removeprefix("PARAMETER_").lower() for k, v in vars(ParameterType).items() if k.startswith("PARAMETER_")}
    lines = ["| parameter | type | default | range | unit | set | |", "|---|---|---|---|---|---|---|"]
    for name, value, descriptor in zip(names, values, descriptors, strict=True):
        ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
        span = f"{ranges[0].from_value:g} to {ranges[0].to_value:g}" if ranges else descriptor.additional_constraints
        when = "at start" if descriptor.read_only else "any time"
        assert descriptor.description, f"{node}: {name} has no description"
        # Descriptors have no field for the unit: crates/ros puts it behind the text.
        text, _, unit = descriptor.description.partition(" Unit: ")
        cells = [f"`{name}`", types[descriptor.type], parameter_value_to_python(value), span, unit.removesuffix("."), when, text]
        lines.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("node", NODES)
def test_the_parameters_tables_are_those_of_the_nodes(client, running, node):
    table = parameter_table(client, node)
    text = DOCUMENT.read_text()
    begin, end = f"<!-- parameters: {node} -->\n", "<!-- end -->"
    head, rest = text.split(begin, 1)
    if os.environ.get("TANDEM_UPDATE_DOCS"):
        DOCUMENT.write_text(head + begin + table + rest[rest.index(end) :])
    else:
        assert rest[: rest.index(end)] == table
