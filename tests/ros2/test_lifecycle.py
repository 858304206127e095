"""Managed nodes: our three against rclpy's own lifecycle node, and what they do at each transition."""

import math
import os
import time
from importlib.metadata import version

import pytest
from conftest import ActionUser, Client, wait_until
from test_walk import Robot

NODES = ["planner", "controller", "sim_bridge"]
CHANGES = {"configure": 1, "cleanup": 2, "activate": 3, "deactivate": 4}


class Managed:
    """A client of one node's lifecycle services."""

    def __init__(self, client, node):
        from lifecycle_msgs.msg import TransitionEvent
        from lifecycle_msgs.srv import ChangeState, GetAvailableStates, GetAvailableTransitions, GetState

        self.client = client
        self.types = ChangeState, GetState, GetAvailableStates, GetAvailableTransitions
        names = ["change_state", "get_state", "get_available_states", "get_available_transitions", "get_transition_graph"]
        kinds = [ChangeState, GetState, GetAvailableStates, GetAvailableTransitions, GetAvailableTransitions]
        self.services = {name: client.service(kind, f"{node}/{name}") for name, kind in zip(names, kinds, strict=True)}
        self.events = []
        client.node.create_subscription(TransitionEvent, f"{node}/transition_event", self.events.append, 100)

    def ask(self, name, request=None):
        service = self.services[name]
        return self.client.call(service, request or service.srv_type.Request())

    def change(self, id=0, label=""):
        from lifecycle_msgs.msg import Transition

        return self.ask("change_state", self.types[0].Request(transition=Transition(id=id, label=label))).success

    def state(self):
        state = self.ask("get_state").current_state
        return state.id, state.label

    def states(self):
        return [(state.id, state.label) for state in self.ask("get_available_states").available_states]

    def transitions(self, name="get_available_transitions"):
        return [described(transition) for transition in self.ask(name).available_transitions]


def described(t):
    return t.transition.id, t.transition.label, t.start_state.id, t.start_state.label, t.goal_state.id, t.goal_state.label


# Every transition that leads somewhere, some by number and some by label, with refusals between them.
WALK_THROUGH = [
    (3, ""), (0, "configure"), (0, "bogus"), (1, ""), (250, ""), (3, ""), (1, ""), (4, ""), (2, ""), (1, ""), (3, ""), (4, ""),
    (0, "activate"), (0, "shutdown"), (1, ""),
]  # fmt: skip
IMPOSSIBLE = {0, 3, 4, 6, 14}
# Jazzy's lifecycle node dies of a number that is impossible in its state: there both are asked only for what is
# possible.
if version("ros-rclpy").startswith("7."):
    WALK_THROUGH = [asked for index, asked in enumerate(WALK_THROUGH) if index not in IMPOSSIBLE]


def walk_through(managed):
    """What a node says at each step."""
    observed = [managed.states(), managed.transitions("get_transition_graph"), managed.state(), managed.transitions()]
    for id, label in WALK_THROUGH:
        observed.append((id, label, managed.change(id, label), managed.state(), managed.transitions()))
    return observed


@pytest.fixture(scope="module")
def reference(ros, client):
    """What rclpy's own node says."""
    from rclpy.lifecycle import LifecycleNode

    node = LifecycleNode("reference")
    client.executor.add_node(node)
    managed = Managed(client, "/reference")
    yield walk_through(managed)
    client.executor.remove_node(node)
    node.destroy_node()


@pytest.mark.parametrize("node", NODES)
def test_a_node_says_what_rclpys_own_lifecycle_node_says(client, processes, reference, node):
    process = processes(f"tandem_{node}", "--ros-args", "-r", "__ns:=/managed", "-p", "autostart:=false", name=f"managed-{node}")
    managed = Managed(client, f"/managed/{node}")
    time.sleep(0.3)
    assert managed.state() == (1, "unconfigured")
    assert walk_through(managed) == reference
    # Each change is reported twice: on the way and done.
    path = [(event.start_state.label, event.goal_state.label) for event in managed.events]
    assert path[:4] == [
        ("unconfigured", "configuring"), ("configuring", "inactive"), ("inactive", "activating"), ("activating", "active"),
    ]  # fmt: skip
    assert path[-1] == ("shuttingdown", "finalized")
    assert all(before[1] == after[0] for before, after in zip(path, path[1:]))
    assert all(abs(event.timestamp * 1e-9 - time.time()) < 120 and event.transition.id for event in managed.events)
    assert process.alive(), "a finalized node stays until it is asked to go"
    assert process.stop() == 0, process.text()


def test_a_planner_that_cannot_be_configured_stays_unconfigured_and_says_why(client, processes, tmp_path):
    folder = tmp_path / "robot"
    arguments = ["--ros-args", "-r", "__ns:=/unready", "-p", f"robot:={folder}"]
    process = processes("tandem_planner", *arguments, "-p", "autostart:=false")
    managed = Managed(client, "/unready/planner")
    assert not managed.change(label="configure")
    assert managed.state() == (1, "unconfigured")
    assert str(folder) in process.text()
    # The same node is configured once the folder is there.
    from conftest import ROOT

    os.symlink(ROOT / "config/robots/vision60", folder)
    assert managed.change(label="configure")
    assert process.stop() == 0
    folder.unlink()
    hasty = processes("tandem_planner", *arguments)
    wait_until(lambda: not hasty.alive(), 10, "it ends, because autostart is true")
    assert hasty.process.returncode == 1 and str(folder) in hasty.text()


def test_an_inactive_planner_refuses_and_an_active_one_plans_again(client, processes):
    from tandem_msgs.action import GenerateGait as Action
    from tandem_msgs.srv import GenerateGait

    processes("tandem_planner", "--ros-args", "-r", "__ns:=/resting")
    managed = Managed(client, "/resting/planner")
    plan = client.service(GenerateGait, "/resting/generate_gait")
    assert client.call(plan, GenerateGait.Request(behaviour="amble")).success
    assert managed.change(label="deactivate")
    response = client.call(plan, GenerateGait.Request(behaviour="amble"))
    assert (response.success, response.status) == (False, "inactive") and "change_state" in response.message
    user = ActionUser("goals", Action, "/resting/generate_gait")
    goal = user.actions.send_goal_async(Action.Goal(behaviour="amble"))
    wait_until(goal.done, 20, "the goal is answered")
    assert not goal.result().accepted
    user.close()
    # Cleaned up, its endpoints are gone; configured and activated, they are there again.
    assert managed.change(label="cleanup")
    wait_until(lambda: client.node.count_publishers("/resting/gait") == 0, 10, "the topic is gone")
    assert managed.change(label="configure") and managed.change(label="activate")
    again = client.service(GenerateGait, "/resting/generate_gait")
    assert client.call(again, GenerateGait.Request(behaviour="gait1")).success


def tilt_rad(pose):
    return math.acos(1 - 2 * (pose.orientation.x**2 + pose.orientation.y**2))


def test_a_walking_robot_comes_to_rest_when_its_controller_is_deactivated(processes, ros):
    from std_srvs.srv import Trigger

    robot = Robot(processes, ros, "/deactivated")
    try:
        managed = Managed(robot.client, "/deactivated/controller")
        assert robot.generate(behaviour="gait1").success
        robot.wait(lambda: robot.gaits, 10, "the gait")
        robot.pause(False)
        for request in ("arm", "stand", "walk"):
            robot.trigger(request)
        robot.wait(lambda: robot.mode() == "walking", 60, "walking")
        robot.states.clear()
        assert managed.change(label="deactivate")
        wait_until(lambda: robot.mode() == "damping", 10, "damping")
        assert robot.states[-1].fault == "emergency_stop", "so is being inactive called"
        modes = [state.mode for state in robot.states]
        order = [mode for index, mode in enumerate(modes) if index == 0 or modes[index - 1] != mode]
        assert order in (["walking", "stopping", "standing", "damping"], ["stopping", "standing", "damping"]), order
        # Nothing moves it until it is active again, and then only when it is asked.
        for request in ("stand", "walk", "arm"):
            response = robot.client.call(robot.service(Trigger, request), Trigger.Request())
            assert not response.success and "not active" in response.message, response
        assert managed.change(label="activate")
        time.sleep(0.5)
        assert robot.mode() == "damping", "activating arms nothing and moves nothing"
        sinking = [pose for pose in (odom.pose.pose for odom in robot.odometry) if pose.position.z > 0.3]
        assert max(tilt_rad(pose) for pose in sinking) < 0.1, "it stood still before it sank, and sank level"
        assert tilt_rad(robot.odometry[-1].pose.pose) < 0.4, "it lies on its belly, leaning on the legs that it folded"
        stand = robot.service(Trigger, "stand")
        asked = lambda: robot.client.call(stand, Trigger.Request()).success  # refused until it is at rest
        wait_until(asked, 20, "it is at rest and stands up")
        wait_until(lambda: robot.mode() == "standing", 60, "standing again")
        # Shut down, it is damped too, and stays seen.
        assert managed.change(label="shutdown")
        assert managed.state() == (4, "finalized")
        assert robot.nodes[1].alive()
    finally:
        for node in reversed(robot.nodes):
            node.stop()
        robot.watching = False
        robot.watcher.join()
        robot.aside.destroy_node()
        robot.client.close()


def test_the_simulations_time_stands_still_while_it_is_inactive(client, processes):
    from rosgraph_msgs.msg import Clock
    from std_srvs.srv import Trigger
    from test_walk import best_effort

    processes("tandem_sim_bridge", "--ros-args", "-r", "__ns:=/frozen", "-r", "/clock:=/frozen/clock")
    managed = Managed(client, "/frozen/sim_bridge")
    clocks = []
    client.node.create_subscription(Clock, "/frozen/clock", clocks.append, best_effort(1))
    wait_until(lambda: clocks, 20, "time passes")
    assert managed.change(label="deactivate")
    time.sleep(0.3)
    clocks.clear()
    response = client.call(client.service(Trigger, "/frozen/reset"), Trigger.Request())
    assert not response.success and "not active" in response.message
    time.sleep(0.5)
    assert not clocks
    assert managed.change(label="activate")
    wait_until(lambda: clocks, 5, "time goes on")
