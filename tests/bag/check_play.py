"""A bag that we play is received whole, in order and to the value by a real rclpy subscriber.

    ROS_DOMAIN_ID=85 python check_play.py TANDEM BAG CYCLES        (BAG: written by sample_bag; python: one with rclpy)
"""

import os
import subprocess
import sys
import time

os.environ.setdefault("ROS_DOMAIN_ID", "85")
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"

import rclpy  # noqa: E402  (reads the environment)
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import String  # noqa: E402


def check(condition, what):
    if not condition:
        sys.exit(f"FAILED: {what}")


def play(node, arguments, seconds):
    """Plays to the end, spinning meanwhile; gives the exit code."""
    player = subprocess.Popen(arguments, stdin=subprocess.DEVNULL)
    deadline = time.monotonic() + seconds
    while player.poll() is None and time.monotonic() < deadline:
        rclpy.spin_once(node, timeout_sec=0.05)
    check(player.poll() is not None, f"playing did not end in {seconds} s")
    for _ in range(200):
        rclpy.spin_once(node, timeout_sec=0.005)
    return player.returncode


def main():
    tandem, bag, cycles = sys.argv[1], sys.argv[2], int(sys.argv[3])
    rclpy.init()
    node = rclpy.create_node("listener")
    states, clocks, descriptions = [], [], []
    reliable = QoSProfile(depth=20000, reliability=QoSReliabilityPolicy.RELIABLE)
    latched = QoSProfile(depth=1, reliability=QoSReliabilityPolicy.RELIABLE, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(JointState, "/replayed/joint_states", states.append, reliable)
    node.create_subscription(Clock, "/clock", lambda m: clocks.append(m.clock.sec + m.clock.nanosec * 1e-9), QoSProfile(depth=100, reliability=QoSReliabilityPolicy.BEST_EFFORT))
    node.create_subscription(String, "/robot_description", lambda m: descriptions.append(m.data), latched)
    begun = time.monotonic()
    code = play(node, [tandem, "bag", "play", bag, "--reliable", "--clock", "--rate", "0.5", "--delay", "3",
                       "--topic", "/joint_states", "--topic", "/robot_description",
                       "--ros-args", "-r", "/joint_states:=/replayed/joint_states"], 120)
    took = time.monotonic() - begun
    check(code == 0, f"the player ended with code {code}")
    check(len(states) == cycles, f"{len(states)} joint states came; expected {cycles}")
    for cycle, message in enumerate(states):
        stamp_ns = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
        check(stamp_ns == 1_000_000_000 + cycle * 1_000_000, f"stamp of state {cycle}")
        for joint in range(12):
            check(message.position[joint] == cycle * 0.001 + joint, f"position {joint} of state {cycle}")
            check(message.effort[joint] == 3.0 * (cycle * 0.001 + joint), f"effort {joint} of state {cycle}")
    check(descriptions == ['<robot name="größe"/>'], f"robot_description came {len(descriptions)} times")
    check(len(clocks) > cycles / 1000 / 0.5 * 100 * 0.3, f"only {len(clocks)} clocks")
    check(all(a <= b for a, b in zip(clocks, clocks[1:])), "the clock fell")
    check(clocks[0] >= 0.9 and clocks[-1] <= 1.0 + cycles * 0.001 + 0.1, f"the clock ran from {clocks[0]} to {clocks[-1]}")
    check(took >= cycles / 1000 / 0.5, f"half speed took {took:.1f} s")
    print(f"{cycles} joint states at half speed in {took:.1f} s: received whole and in order by rclpy; {len(clocks)} clocks")
    # A start in the middle sends what is latched from before, and only the rest.
    states.clear()
    descriptions.clear()
    start = cycles / 1000 - 0.5
    code = play(node, [tandem, "bag", "play", bag, "--reliable", "--delay", "3", "--start", str(start), "--ros-args", "-r", "/joint_states:=/replayed/joint_states"], 60)
    check(code == 0, f"the player ended with code {code}")
    check(len(states) == 500, f"{len(states)} joint states came after --start {start}; expected 500")
    check(len(descriptions) == 1, "the latched robot_description from before the start did not come")
    print("seeking: 500 states after the start, and the latched message from before it")
    node.destroy_node()
    rclpy.shutdown()


main()
