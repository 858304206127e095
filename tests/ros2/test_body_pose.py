"""A robot that stands moves its body as `body_pose` asks, and says which feet carry it."""

import math

import pytest
from test_walk import Robot


@pytest.fixture(scope="module")
def robot(processes, ros):
    robot = Robot(processes, ros, "/posed", planner=False)
    yield robot
    robot.close()


class Pose:
    """What is asked for, and what the simulation says of the base."""

    def __init__(self, robot):
        from diagnostic_msgs.msg import DiagnosticArray
        from geometry_msgs.msg import Pose as Message
        from tandem_msgs.msg import FootContacts

        self.robot, self.message, self.contacts, self.problems = robot, Message, [], []
        node = robot.client.node
        self.publisher = node.create_publisher(Message, "/posed/body_pose", 10)
        node.create_subscription(FootContacts, "/posed/foot_contacts", self.contacts.append, 10)
        node.create_subscription(DiagnosticArray, "/diagnostics", self.diagnose, 10)
        robot.wait(lambda: self.publisher.get_subscription_count() == 1, 20, "the controller listens to body_pose")

    def diagnose(self, message):
        self.problems += [status.message for status in message.status if status.name == "/posed/controller: inputs"]

    def ask(self, z=0.0, roll=0.0, x=0.0):
        message = self.message()
        message.position.x, message.position.z = x, z
        message.orientation.x, message.orientation.w = math.sin(roll / 2), math.cos(roll / 2)
        self.publisher.publish(message)

    def base(self):
        pose = self.robot.odometry[-1].pose.pose
        q = pose.orientation
        return pose.position.z, math.atan2(2 * (q.w * q.x + q.y * q.z), 1 - 2 * (q.x * q.x + q.y * q.y))

    def refused(self, reason, **pose):
        """Diagnostics come once in a simulated second and show what was wrong in the last second of the wall clock."""

        def seen():
            self.ask(**pose)
            return any(reason in problem for problem in self.problems)

        self.problems.clear()
        self.robot.wait(seen, 60, f"refused: {reason}")


def test_the_body_follows_stays_and_goes_back(robot):
    pose = Pose(robot)
    robot.pause(False)
    robot.trigger("arm")
    pose.refused("body_pose: refused: only a robot that stands moves its body", z=-0.05)
    robot.trigger("stand")
    robot.wait(lambda: robot.mode() == "standing", 60, "standing")
    began = robot.time()
    robot.wait(lambda: robot.time() > began + 1, 30, "at rest")
    height, roll = pose.base()

    pose.ask(z=-0.06, roll=0.15)
    near = lambda z, r: abs(pose.base()[0] - height - z) < 0.015 and abs(pose.base()[1] - roll - r) < 0.03
    robot.wait(lambda: near(-0.06, 0.15), 30, lambda: f"lowered and rolled: {pose.base()} from {(height, roll)}")
    began = robot.time()
    robot.wait(lambda: robot.time() > began + 5, 60, "five seconds in which nobody asks")
    assert near(-0.06, 0.15), "it stays where it was asked to be"

    pose.refused("expected x and y 0", z=0.01, x=0.1)
    assert near(-0.06, 0.15)

    contacts = pose.contacts[-1]
    assert list(contacts.name) == ["front_left", "rear_left", "front_right", "rear_right"]
    assert all(contacts.contact), contacts
    assert sum(contacts.force_n) == pytest.approx(38 * 9.81, rel=0.15)

    robot.trigger("stand")
    robot.wait(lambda: near(0.0, 0.0), 30, lambda: f"back in the posture: {pose.base()}")
    robot.trigger("sit")
    robot.wait(lambda: robot.mode() == "disarmed", 60, "sat down")
    robot.wait(lambda: not any(pose.contacts[-1].contact), 20, "no drive carries anything")
