"""Messages of megabytes, which go out in thousands of fragments, arrive: from `tandem bag play` in rclpy, and from rclpy in a node of ours."""

import subprocess
import time

import pytest
from conftest import TARGET, Client, wait_until

COUNT, PERIOD_S = 20, 0.2


def large(number, size):
    return f"{number} ".ljust(size, "x")


@pytest.mark.parametrize("megabytes", [1, 3])
def test_large_messages_arrive_from_the_player(processes, ros, tmp_path, megabytes):
    from std_msgs.msg import String

    size = megabytes * 1_000_000
    bag = tmp_path / "bag"
    subprocess.run([TARGET / "examples/large_bag", bag, str(size), str(COUNT), str(PERIOD_S)], check=True, capture_output=True)
    client = Client(f"listener_{megabytes}")
    try:
        came = []
        # rclpy's default: reliable, volatile, depth 10.
        client.node.create_subscription(String, "/large", lambda message: came.append((time.monotonic(), message.data)), 10)
        player = processes("tandem", "bag", "play", str(bag), "--delay", "4")
        wait_until(lambda: player.process.poll() is not None, 40, player.text)
        assert player.process.returncode == 0, player.text()
        wait_until(lambda: len(came) == COUNT, 3, lambda: f"{COUNT} messages; {len(came)} came")
        assert all(data == large(number, size) for number, (_, data) in enumerate(came)), [data[:4] for _, data in came]
        late = [at - came[0][0] - number * PERIOD_S for number, (at, _) in enumerate(came)]
        print(f"{megabytes} MB: {len(came)} of {COUNT}; latest after the first's pace: {max(late):.3f} s")
    finally:
        client.close()


def test_large_messages_reach_a_node_of_ours_and_come_back(processes, ros):
    from tandem_msgs.msg import Gait

    process = processes("examples/exercise", "--ros-args", "-r", "__ns:=/large", "-r", "__node:=exercise")
    client = Client("talker")
    try:
        came = []
        client.node.create_subscription(Gait, "/large/output", lambda message: came.append(message.name), 10)
        publisher = client.node.create_publisher(Gait, "/large/input", 10)
        wait_until(lambda: publisher.get_subscription_count() and client.node.count_publishers("/large/output"), 20, process.text)
        time.sleep(2)  # the other direction's match
        for number in range(COUNT):
            publisher.publish(Gait(name=large(number, 1_000_000)))
            time.sleep(PERIOD_S)
        wait_until(lambda: len(came) == COUNT, 5, lambda: f"{COUNT} messages; {len(came)} came back")
        assert all(name == large(number, 1_000_000) for number, name in enumerate(came))
    finally:
        client.close()
        assert process.stop() == 0, process.text()
