"""What all tests against real ROS 2 clients share: processes with their own domain, and an rclpy node that spins."""

import atexit
import os
import pathlib
import random
import shutil
import signal
import subprocess
import tempfile
import threading
import time

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
TARGET = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release"


def free_domain():
    """A domain in which nobody listens: participant 0 of domain d has UDP port 7410 + 250 d."""
    used = {int(line.split()[1].split(":")[1], 16) for line in pathlib.Path("/proc/net/udp").read_text().splitlines()[1:]}
    # Runs side by side choose from different domains: the first of two from the even ones, "0/2", the second from
    # "1/2".
    rest, of = (int(number) for number in os.environ.get("TANDEM_TEST_SHARE", "0/1").split("/"))
    free = [domain for domain in range(1, 101) if domain % of == rest and 7410 + 250 * domain not in used]
    return random.choice(free)


DOMAIN = int(os.environ.get("TANDEM_TEST_DOMAIN") or free_domain())

os.environ["ROS_DOMAIN_ID"] = str(DOMAIN)
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
# Nodes that are given no other folder record here, not in the folder of whoever runs the tests.
os.environ["XDG_DATA_HOME"] = tempfile.mkdtemp(prefix="tandem-tests-")
os.environ["ROS_LOG_DIR"] = os.environ["XDG_DATA_HOME"] + "/log"
RECORDINGS = pathlib.Path(os.environ["XDG_DATA_HOME"]) / "tandem/recordings"
atexit.register(shutil.rmtree, os.environ["XDG_DATA_HOME"], ignore_errors=True)


def wait_until(condition, seconds, what):
    """Waits for a condition, at most so long; returns its value."""
    deadline = time.monotonic() + seconds
    while True:
        value = condition()
        if value:
            return value
        assert time.monotonic() < deadline, f"after {seconds} s still not: {what() if callable(what) else what}"
        time.sleep(0.02)


class Process:
    """A node's process with its log."""

    def __init__(self, program, arguments, log):
        self.log = pathlib.Path(log)
        self.log.parent.mkdir(parents=True, exist_ok=True)
        with open(self.log, "wb") as output:
            self.process = subprocess.Popen([str(program), *arguments], stdout=output, stderr=subprocess.STDOUT, cwd=ROOT)

    def text(self):
        return self.log.read_text(errors="replace")

    def alive(self):
        return self.process.poll() is None

    def stop(self, with_signal=signal.SIGINT, seconds=10):
        """Ends the process and returns its exit code; kills it when it does not end."""
        if self.alive():
            self.process.send_signal(with_signal)
        try:
            return self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise AssertionError(f"{self.process.args[0]} did not end within {seconds} s; its log:\n{self.text()}") from None


@pytest.fixture(scope="module")
def processes(tmp_path_factory):
    """Starts processes; all are ended after the file's last test: a dozen idle nodes would take a processor from the tests to come."""
    started = []
    folder = tmp_path_factory.mktemp("logs")

    def start(program, *arguments, name=None):
        path = TARGET / program
        assert path.exists(), f"{path} is missing: build it first (launch-scripts/test does)"
        process = Process(path, arguments, folder / f"{len(started)}-{name or path.name}.log")
        started.append(process)
        return process

    yield start
    for process in reversed(started):
        if process.alive():
            process.process.terminate()
    for process in started:
        try:
            process.process.wait(5)
        except subprocess.TimeoutExpired:
            process.process.kill()


class Client:
    """An rclpy node on a thread of its own."""

    def __init__(self, name, **arguments):
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        self.node = rclpy.create_node(name, **arguments)
        self.build()
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.thread = threading.Thread(target=self._spin, daemon=True)
        self.thread.start()

    def build(self):
        """What the node has from the start."""

    def _spin(self):
        from rclpy.executors import ExternalShutdownException
        from rclpy.exceptions import InvalidHandle

        while True:
            try:
                return self.executor.spin()
            except ExternalShutdownException:
                return
            except InvalidHandle:
                # A test destroyed what the executor was about to wait for: rclpy does not guard against that, and a
                # client whose thread had ended would wait for every later answer in vain.
                continue

    def service(self, type_, name, seconds=40, depth=10):
        """A client of a service that is there. `depth`: answers that it keeps, its own and those to the service's other clients."""
        from rclpy.qos import QoSProfile

        client = self.node.create_client(type_, name, qos_profile=QoSProfile(depth=depth))
        assert client.wait_for_service(seconds), f"service {name} did not appear within {seconds} s"
        return client

    def call(self, client, request, seconds=20):
        future = client.call_async(request)

        def answered():
            assert self.thread.is_alive(), "this client's thread has ended: what ended it is among the warnings"
            return future.done()

        wait_until(answered, seconds, f"response of {client.srv_name}")
        return future.result()

    def close(self):
        self.executor.shutdown(1)
        self.thread.join(5)
        self.node.destroy_node()


class ActionUser(Client):
    """A node with one action client. rclpy hands an action client to the executor before it has built it and destroys it under the
    executor's hands, which ends the executor's thread: here it is built before the thread starts and destroyed after it."""

    def __init__(self, name, type_, action):
        self.type, self.action = type_, action
        super().__init__(name)
        assert self.actions.wait_for_server(40), f"action {action} did not appear"
        time.sleep(0.1)

    def build(self):
        from rclpy.action import ActionClient

        self.actions = ActionClient(self.node, self.type, self.action)

    def close(self):
        self.executor.shutdown(1)
        self.thread.join(5)
        self.actions.destroy()
        self.node.destroy_node()


@pytest.fixture(scope="session")
def ros():
    import rclpy

    rclpy.init()
    yield rclpy
    rclpy.try_shutdown()


@pytest.fixture(scope="module")
def client(ros):
    client = Client("tester")
    yield client
    client.close()
