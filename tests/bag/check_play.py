"""A bag that we play is received whole, in order and to the value by a real rclpy subscriber.

    ROS_DOMAIN_ID=85 python check_play.py TANDEM BAG CYCLES        [FOREIGN...]

BAG: written by sample_bag; FOREIGN: by check_foreign.py; python: one with rclpy.
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


def ripe(condition, since_s):
    return condition(since_s) if callable(condition) else since_s >= condition


def play(node, came, arguments, seconds, lines=()):
    """Plays to the end, spinning meanwhile. The player begins paused and goes on after six seconds; `lines`:
    (s after that, or a condition of the time since, and what) for its standard input. Returns once nothing more
    is added to `came`, with its exit code."""
    player = subprocess.Popen(arguments, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)

    def say(line):
        player.stdin.write(line + "\n")
        player.stdin.flush()

    deadline = time.monotonic() + seconds
    # Time for both sides to find each other; the graph still shows the player before.
    found = time.monotonic() + 6
    while time.monotonic() < found and player.poll() is None:
        rclpy.spin_once(node, timeout_sec=0.05)
    begun, waiting = time.monotonic(), [(0, "resume"), *lines]
    while player.poll() is None and time.monotonic() < deadline:
        rclpy.spin_once(node, timeout_sec=0.05)
        while waiting and ripe(waiting[0][0], time.monotonic() - begun):
            say(waiting.pop(0)[1])
    if player.poll() is None:
        player.kill()
        player.wait()
        sys.exit(f"FAILED: playing did not end in {seconds} s")
    count, quiet = -1, time.monotonic()
    while time.monotonic() < quiet + 1:
        rclpy.spin_once(node, timeout_sec=0.005)
        if len(came) != count:
            count, quiet = len(came), time.monotonic()
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
    code = play(node, states, [tandem, "bag", "play", bag, "--reliable", "--clock", "--rate", "0.5", "--pause",
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
    def again(what, *options, seconds=60, lines=(), from_bag=bag):
        """Plays with the usual remapping; gives the stamps of the states that came, in ms since the bag's first."""
        states.clear()
        descriptions.clear()
        clocks.clear()
        code = play(node, states, [tandem, "bag", "play", from_bag, "--reliable", "--pause", *options, "--ros-args", "-r",
                           "/joint_states:=/replayed/joint_states"], seconds, lines)
        check(code == 0, f"{what}: the player ended with code {code}")
        return [round(m.header.stamp.sec * 1000 + m.header.stamp.nanosec * 1e-6) - 1000 for m in states]

    # A start in the middle sends what is latched from before, and only the rest.
    came = again("seeking", "--start", str(cycles / 1000 - 0.5))
    check(came == list(range(cycles - 500, cycles)), f"{len(came)} joint states came after the start, expected the last 500")
    check(len(descriptions) == 1, "the latched robot_description from before the start did not come")
    print("start: 500 states after it, and the latched message from before it")
    # Paused in the middle, the clock stands still; then it goes on faster, to the end.
    stands = lambda _: any(clocks.count(clock) > 60 for clock in clocks[-1:])
    came = again("pause", "--clock", "--rate", "0.5", "--start", str(cycles / 1000 - 1), lines=[(0.5, "pause"), (stands, "rate 10"), (stands, "resume")])
    check(came == list(range(cycles - 1000, cycles)), f"{len(came)} joint states came, expected 1000")
    longest = max(sum(1 for other in clocks if other == clock) for clock in set(clocks))
    check(longest > 50, f"the clock stood still for {longest} messages while it was paused")
    # Asked to seek by what was received, not by the clock: however late that is, it was no faster than asked.
    asked_s = []
    received = lambda since_s: len(states) >= 150 and asked_s.append(since_s) is None
    came = again("seek", "--rate", "0.1", "--start", str(cycles / 1000 - 0.5),
                 lines=[(received, f"seek {cycles / 1000 - 1}"), (0, "rate 10")])
    back = next((n for n in range(1, len(came)) if came[n] < came[n - 1]), 0)
    check(came[back:] == list(range(cycles - 1000, cycles)), f"seeking back sent {len(came) - back} states from {came[back]} to {came[-1]}")
    check(came[0] == cycles - 500 and back >= 150, f"{back} states came before the seek")
    check(asked_s[0] > 1.4, f"150 ms of states came in {asked_s[0]:.2f} s at a tenth of the rate")
    # In a loop it begins again until it is asked to quit.
    came = again("loop", "--loop", "--rate", "10", lines=[(lambda _: len(states) > 2 * cycles, "quit")], seconds=120)
    rounds = sum(1 for n in came if n == 0)
    check(rounds >= 2 and came[: 2 * cycles] == list(range(cycles)) * 2, f"{rounds} rounds in a loop")
    print(f"pause, resume, rates 0.1 and 10, seek and quit on standard input work; {rounds} rounds in a loop, none with a hole")
    # Bags that rosbags' own writer made.
    for foreign in sys.argv[4:]:
        came = again(foreign, from_bag=foreign)
        check(came == list(range(500)), f"{foreign}: {len(came)} joint states came, expected 500")
        check(states[7].header.frame_id == 'base, "link"' and states[7].position[3] == 7 + 3 / 16, f"{foreign}: values")
        print(f"{os.path.basename(foreign)}, written by rosbags: 500 joint states received whole")
    node.destroy_node()
    rclpy.shutdown()


main()
