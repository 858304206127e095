"""docs/getting-started.md as it stands: every indented line is read from the page and run. There is no `ros2` here; what its command line
does with a service, a topic and a YAML text is done with rclpy."""

import argparse
import os
import re
import shlex
import subprocess
import sys
import time

import pytest
import yaml
from conftest import ROOT, Client, wait_until

PAGE = ROOT / "docs/getting-started.md"
# Lines that install; test_install.py runs the first, the page says so.
INSTALL = "Install"
LAUNCH = "ros2 launch tandem simulation.launch.py"


def lines_of(text):
    """[(section, line)] of the page's indented lines."""
    section, found = "", []
    for line in text.splitlines():
        section = line[3:] if line.startswith("## ") else section
        if line.startswith("    "):
            found.append((section, line.strip()))
    return found


@pytest.fixture
def home(tmp_path, monkeypatch):
    """The page names ~: a home of its own for the nodes, and what they record there."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv("XDG_DATA_HOME", raising=False)
    monkeypatch.delenv("ROS_LOG_DIR", raising=False)
    return tmp_path


def start_nodes(processes):
    """The page's programs. In lockstep, where a loaded machine changes nothing; simulated time then runs as fast as it can."""
    started = []
    for _, line in lines_of(PAGE.read_text()):
        found = re.fullmatch(r"target/release/(tandem_\w+)( --ros-args .*)?", line)
        if found:
            given = shlex.split(found[2] or " --ros-args")
            pace = {"tandem_controller": ["-p", "mode:=lockstep"]}.get(found[1], [])
            pace = {"tandem_sim_bridge": ["-p", "mode:=lockstep", "-p", "lockstep_timeout_s:=60.0"]}.get(found[1], pace)
            started.append(processes(found[1], *given, *pace))
    assert len(started) == 3
    return started


def fill(message, values):
    """Sets a message's fields as `ros2 service call` and `ros2 topic pub` do from YAML."""
    for name, value in (values or {}).items():
        inner = getattr(message, name)  # a field that is not there is an error
        if isinstance(value, dict):
            fill(inner, value)
        else:
            setattr(message, name, value)
    return message


def type_of(name, kind):
    package, middle, type_ = name.split("/")
    assert middle == kind, name
    return getattr(__import__(f"{package}.{kind}", fromlist=[type_]), type_)


class Terminal:
    """Runs the page's lines."""

    def __init__(self, nodes):
        self.nodes, self.client = nodes, Client("terminal")

    def check(self):
        for node in self.nodes:
            assert node.alive() and "ERROR fault" not in node.text(), node.text()
        return True

    def run(self, line):
        words = shlex.split(line)
        match words[:3]:
            case ["ros2", "service", "call"]:
                self.call(*words[3:])
            case ["ros2", "topic", "echo"]:
                self.echo(words[3:])
            case ["ros2", "topic", "pub"]:
                assert words[3] == "--once", line
                self.publish(*words[4:])
            case ["ros2", "node", "list"]:
                expected = {"/planner", "/controller", "/sim_bridge"}
                wait_until(lambda: expected <= self.listed(), 30, self.listed)
            case _:
                raise AssertionError(f"the page has a line that this test cannot run: {line}")

    def listed(self):
        return {f"{namespace.rstrip('/')}/{name}" for name, namespace in self.client.node.get_node_names_and_namespaces()}

    def call(self, name, type_, values="{}"):
        type_ = type_of(type_, "srv")
        client, request = self.client.service(type_, name), fill(type_.Request(), yaml.safe_load(values))
        ask = lambda: self.client.call(client, request, 60)
        answer = ask()
        # As the page says of a robot that was just put down; how soon `arm` is asked is this machine's load.
        deadline = time.monotonic() + 60
        while name == "/arm" and "Wait until the robot is at rest" in answer.message and time.monotonic() < deadline:
            time.sleep(0.5)
            answer = ask()
        assert answer.success, f"{name}: {answer.message}"

    def echo(self, words):
        """One message, of those that pass the filter; the type and the quality of service are the publisher's, as for the command."""
        from rclpy.qos import QoSProfile

        parser = argparse.ArgumentParser()
        for option in ("--field", "--filter"):
            parser.add_argument(option)
        parser.add_argument("--once", action="store_true", required=True)
        parser.add_argument("topic")
        parser.add_argument("type", nargs="?")
        asked = parser.parse_args(words)
        node, received = self.client.node, []
        (offer, *_) = wait_until(lambda: node.get_publishers_info_by_topic(asked.topic), 30, f"a publisher of {asked.topic}")
        assert asked.type in (None, offer.topic_type), f"{asked.topic} is a {offer.topic_type}"
        quality = QoSProfile(depth=10, reliability=offer.qos_profile.reliability, durability=offer.qos_profile.durability)
        passes = eval(f"lambda m: {asked.filter or True}")  # a Python expression of m, the page's own text
        listen = lambda message: received.append(message) if passes(message) else None
        subscription = node.create_subscription(type_of(offer.topic_type, "msg"), asked.topic, listen, quality)
        wait_until(lambda: self.check() and received, 90, lambda: f"{shlex.join(words)}\n" + "\n".join(n.text()[-1000:] for n in self.nodes))
        message = received[0]
        for field in (asked.field or "").split(".") if asked.field else []:
            message = getattr(message, field)
        node.destroy_subscription(subscription)

    def publish(self, topic, type_, values):
        type_ = type_of(type_, "msg")
        publisher = self.client.node.create_publisher(type_, topic, 10)
        wait_until(lambda: publisher.get_subscription_count() > 0, 30, f"a subscription to {topic}")
        publisher.publish(fill(type_(), yaml.safe_load(values)))
        self.published = publisher  # kept: one that leaves at once may take its message with it

    def close(self):
        self.client.close()


def shell(command, home):
    """The rest of the page's lines, by a shell in the clone; what they write, but for recordings, goes below `home`."""
    command = command.replace("-o first_walk.html", f"-o {home}/first_walk.html")
    done = subprocess.run(["bash", "-ec", command], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
    return done.stdout


def test_every_line_of_the_page_does_what_it_says(processes, ros, home):
    nodes = start_nodes(processes)
    terminal = Terminal(nodes)
    playing = None
    for section, line in lines_of(PAGE.read_text()):
        if section == INSTALL or line == LAUNCH or re.match(r"target/release/tandem_|python3 |target/release/examples/", line):
            continue  # started above, or by the test below
        if line.startswith("target/release/tandem ") and terminal.nodes:
            stop(terminal.nodes)
            terminal.nodes = []
        if line.endswith("&"):
            playing = subprocess.Popen(shlex.split(os.path.expanduser(line[:-1].replace(" ~", f" {home}"))), cwd=ROOT)
        elif line == "wait":
            assert playing.wait(120) == 0
        elif line.startswith(("target/release/", "grep ")):
            assert shell(line, home)
        else:
            # Beside a player that was just started: without a type the command ends where the topic is not there yet.
            assert not playing or line.endswith("/msg/ControllerState"), line
            terminal.run(line)
    terminal.close()
    assert playing is not None and (home / "first_walk.html").stat().st_size > 100_000


def stop(nodes):
    for node in reversed(nodes):
        assert node.stop() == 0, node.text()


def test_the_same_in_python_and_in_rust(processes, ros, home):
    nodes = start_nodes(processes)
    lines = [line for section, line in lines_of(PAGE.read_text()) if section == "The same in a program"]
    assert len(lines) == 2
    for line in lines:
        printed = shell(line.replace("python3 ", f"{sys.executable} "), home)
        assert [part.split(":")[0] for part in printed.splitlines() if part.split(":")[0] != "generate_gait"] == ["arm", "stand", "walk", "stop", "sit"]
    stop(nodes)


def test_the_readme_walks_within_ten_commands_and_by_this_page():
    section = (ROOT / "README.md").read_text().split("## By hand\n", 1)[1].split("\n## ", 1)[0]
    readme = [re.sub(r"\s+#.*", "", line.strip()) for line in section.splitlines() if line.startswith("    ")]
    page = iter([line for _, line in lines_of(PAGE.read_text())])
    missing = [line for line in readme if line not in page]
    assert not missing, "on the page, in this order, where every line is run"
    assert readme.index("ros2 service call /walk std_srvs/srv/Trigger") < 10


def test_the_launch_file_of_the_page_is_there():
    from xml.etree import ElementTree

    _, _, package, file = LAUNCH.split()
    assert ElementTree.parse(ROOT / "launch-scripts/package.xml").findtext("name") == package
    assert (ROOT / "launch-scripts" / file).is_file() and LAUNCH in PAGE.read_text()
