"""How many answers reach clients that ask all at once and only then listen: ours and rclpy's server, clients with rclpy's default
depth and with a deeper one. Every client of a service receives the answers to all of its clients and keeps the newest `depth` of them.

    .tools/rclpy-kilted/bin/python tests/ros2/answers.py
"""

import subprocess
import sys
import time

from conftest import TARGET

CLIENTS, CALLS = 4, 8
RCLPY_SERVER = """
import rclpy
from rclpy.executors import ExternalShutdownException
from std_srvs.srv import Trigger
rclpy.init()
node = rclpy.create_node("of_rclpy")
def answer(request, response):
    response.success, response.message = False, "refused"
    return response
node.create_service(Trigger, "/of_rclpy/arm", answer)
try:
    rclpy.spin(node)
except (KeyboardInterrupt, ExternalShutdownException):
    pass
"""


def count(service, depth):
    """Answers that arrive, of CLIENTS * CALLS."""
    import rclpy
    from rclpy.context import Context
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.qos import QoSProfile
    from std_srvs.srv import Trigger

    context = Context()
    rclpy.init(context=context)
    nodes = [rclpy.create_node(f"asking_{number}", context=context) for number in range(CLIENTS)]
    clients = [node.create_client(Trigger, service, qos_profile=QoSProfile(depth=depth)) for node in nodes]
    for client in clients:
        assert client.wait_for_service(40), f"{service} did not appear"
    time.sleep(0.5)
    futures = [client.call_async(Trigger.Request()) for _ in range(CALLS) for client in clients]
    time.sleep(2)  # everything is answered, and nobody has listened yet
    executor = SingleThreadedExecutor(context=context)
    for node in nodes:
        executor.add_node(node)
    deadline = time.monotonic() + 5
    while time.monotonic() < deadline and not all(future.done() for future in futures):
        executor.spin_once(0.1)
    answered = sum(future.done() for future in futures)
    executor.shutdown()
    context.shutdown()
    return answered


def main():
    ours = subprocess.Popen([TARGET / "tandem_controller", "--ros-args", "-r", "__ns:=/ours", "--log-level", "error"])
    theirs = subprocess.Popen([sys.executable, "-c", RCLPY_SERVER])
    try:
        for service, name in (("/ours/arm", "tandem_controller"), ("/of_rclpy/arm", "a server of rclpy")):
            for depth in (10, 100):
                print(f"{name}, clients of depth {depth}: {count(service, depth)} of {CLIENTS * CALLS} answers", flush=True)
    finally:
        for process in (ours, theirs):
            process.terminate()
            process.wait(10)


if __name__ == "__main__":
    main()
