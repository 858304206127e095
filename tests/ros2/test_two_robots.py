"""Two robots side by side in one domain, distinguished by namespace and prefixes: both walk, and neither notices the other."""

import importlib.util
import time

import pytest
from conftest import wait_until
from test_cyclone import Cyclone
from test_walk import Robot, seconds, upright


@pytest.fixture
def robots(processes, ros):
    robots = {
        side: Robot(
            processes, ros, f"/{side}",
            parameters=[f"joint_prefix:={side}_", f"frame_prefix:={side}/"], controller=[f"joint_prefix:={side}_"],
        )
        for side in ("left", "right")
    }  # fmt: skip
    yield robots
    for robot in robots.values():
        robot.close()


def test_two_robots_walk_in_one_domain(robots, ros):
    from std_msgs.msg import Bool

    # tf2_msgs has no wheel: Cyclone DDS, which only Kilted's environment has, reads /tf, from a structure made of
    # geometry_msgs' own.
    cyclone = Cyclone() if importlib.util.find_spec("cyclonedds") else None
    transforms = cyclone and cyclone.reader("/tf", "tf2_msgs/msg/TFMessage", "reliable")
    left, right = robots["left"], robots["right"]
    for robot, gait in ((left, "amble"), (right, "gait1")):
        assert robot.generate(behaviour=gait).success
        robot.wait(lambda robot=robot: robot.gaits, 10, "its gait")
        wait_until(lambda robot=robot, gait=gait: f'gait "{gait}"' in robot.nodes[1].text(), 10, "its controller has it")
        for request in ("arm", "stand", "walk"):
            robot.trigger(request)
    for robot in (left, right):
        robot.pause(False)
    for robot in (left, right):
        robot.wait(lambda robot=robot: robot.mode() == "walking", 90, "walking")
    # The motion grows out of standing: its first steps are shorter.
    walking = {robot: robot.time() for robot in (left, right)}
    for robot in (left, right):
        robot.wait(lambda robot=robot: robot.time() > walking[robot] + 2, 60, "2 s of walking")
    began = {robot: (robot.time(), robot.odometry[-1].pose.pose.position.x) for robot in (left, right)}
    for robot in (left, right):
        robot.wait(lambda robot=robot: robot.time() > began[robot][0] + 5, 120, "5 s of walking")
    assert left.mode() == right.mode() == "walking"
    moved = {robot: robot.odometry[-1].pose.pose.position.x - began[robot][1] for robot in (left, right)}
    took = {robot: robot.time() - began[robot][0] for robot in (left, right)}
    assert moved[left] / took[left] == pytest.approx(0.35, rel=0.25) and abs(moved[right] / took[right]) < 0.05, moved
    for robot in (left, right):
        walked = [message for message in robot.odometry if seconds(message.header.stamp) >= began[robot][0]]
        assert walked and all(upright(message) for message in walked), "it fell"
    # Each received its own gait, joints and frames, and nobody else's.
    assert {gait.name for gait in left.gaits} == {"amble"} and {gait.name for gait in right.gaits} == {"gait1"}
    for side, robot in robots.items():
        assert all(name.startswith(f"{side}_") for name in robot.joint_names)
        assert {message.header.frame_id for message in robot.odometry} == {f"{side}/odom"}
    if cyclone:
        frames = {(t.header.frame_id, t.child_frame_id) for message in transforms.take(100) for t in message.transforms}
        assert frames == {(f"{side}/odom", f"{side}/base_link") for side in robots}
    # One is stopped, the other walks on.
    stop = left.client.node.create_publisher(Bool, "/left/emergency_stop", 1)
    wait_until(lambda: stop.get_subscription_count() == 1, 20, "the emergency stop has a subscriber")
    time.sleep(0.2)
    stop.publish(Bool(data=True))
    wait_until(lambda: left.mode() == "damping", 20, "left is damped")
    steps = right.states[-1].step_index
    right.wait(lambda: right.states[-1].step_index > steps + 2, 60, "right walks on")
    assert right.mode() == "walking" and not right.states[-1].fault
    left.states.clear()  # its emergency stop is no fault of this test
