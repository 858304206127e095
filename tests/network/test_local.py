"""ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST: what another host sends is not received, neither to a port nor to the group."""

import os
import subprocess
import sys
import time

import pytest
import rtps
from conftest import TARGET, wait_until
from test_hosts import PLANNER, ROBOT, hosts  # noqa: F401 (hosts is a fixture)

# A participant announces itself from the other host, and says that it is found on the loopback: whoever receives it
# asks there.
FOUND_AT = 45555
SEND = """
import socket, sys, time
out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
for _ in range(20):
    for port in map(int, sys.argv[2:]):
        for address in ("10.77.0.2", "239.255.0.1"):
            out.sendto(bytes.fromhex(sys.argv[1]), (address, port))
    time.sleep(0.1)
"""
LISTEN = f"""
import socket
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.bind(("127.0.0.1", {FOUND_AT}))
# As any other ROS 2 program of this host does: what one socket joined, Linux gives to all that do not object.
group = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
group.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton("239.255.0.1") + socket.inet_aton("10.77.0.2"))
print("ready", flush=True)
s.settimeout(5)
try:
    print("asked" if s.recv(65536)[:4] == b"RTPS" else "garbage", flush=True)
except TimeoutError:
    print("nothing", flush=True)
"""


@pytest.mark.parametrize("range_, expected", [("LOCALHOST", "nothing"), ("SUBNET", "asked")])
def test_what_comes_from_elsewhere_is_received_on_the_subnet_only(hosts, range_, expected):  # noqa: F811
    environment = {**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": range_, "ROS_DOMAIN_ID": "0"}
    inside = lambda host, *command, **more: subprocess.Popen(["ip", "netns", "exec", host, *command], **more)
    node = inside(ROBOT, str(TARGET / "tandem_planner"), env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    listener = inside(ROBOT, sys.executable, "-c", LISTEN, stdout=subprocess.PIPE, text=True)
    try:
        assert listener.stdout.readline() == "ready\n"
        time.sleep(2)
        assert node.poll() is None
        ports = map(str, (7400, 7401, 7410, 7411))
        foreign = rtps.announcement(rtps.RUSTDDS + bytes(range(10)), "127.0.0.1", FOUND_AT)
        inside(PLANNER, sys.executable, "-c", SEND, foreign.hex(), *ports).wait(20)
        assert listener.stdout.readline() == expected + "\n"
    finally:
        for process in (node, listener):
            process.terminate()
            process.wait(10)


def test_a_robots_nodes_find_each_other_beside_a_dozen_other_programs(hosts, tmp_path):  # noqa: F811
    """On a machine whose loopback carries no multicast, as Linux starts it: two controllers must see that they are two."""
    environment = {**os.environ, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    started = []

    def start(program, namespace, *parameters):
        log = tmp_path / f"{len(started)}.log"
        given = ["--ros-args", "-r", f"__ns:={namespace}", *(part for parameter in parameters for part in ("-p", parameter))]
        command = ["ip", "netns", "exec", ROBOT, str(TARGET / program), *given]
        started.append((subprocess.Popen(command, env=environment, stdout=log.open("wb"), stderr=subprocess.STDOUT), log))
        return log

    try:
        others = [start("tandem_planner", f"/other{n}", "autostart:=false") for n in range(14)]
        wait_until(lambda: all(" starts: " in log.read_text() for log in others), 30, "the others run")
        time.sleep(1)
        twins = [start("tandem_controller", "/twins", "overrun_s:=1.0", "middleware_timeout_s:=1.0") for _ in range(2)]
        reported = ("another program publishes joint_command", "fault second_controller")
        seen = lambda: any(words in log.read_text() for log in twins for words in reported)
        wait_until(seen, 20, lambda: "\n".join(log.read_text() for log in twins))
    finally:
        for process, _ in started:
            process.terminate()
        for process, _ in started:
            process.wait(20)
