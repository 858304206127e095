"""A cable that fails one way: an operator's host with the planner, a robot's with its controller, and what one of them says is lost for a
while. Longer than a lease, and each three times: TANDEM_OUTAGES_S=1,5,30,60 TANDEM_OUTAGES_TIMES=3 tests/network/run -k outage"""

import os
import subprocess
import time

import pytest
from conftest import wait_until
from test_hosts import PLANNER, ROBOT, Host, hosts, ip  # noqa: F401 (hosts is a fixture)

OUTAGES_S = [float(seconds) for seconds in os.environ.get("TANDEM_OUTAGES_S", "5").split(",")]
TIMES = int(os.environ.get("TANDEM_OUTAGES_TIMES", "1"))
BACK_S = 5.0
CABLES = {PLANNER: "to_robot", ROBOT: "to_planner"}


def silence(host, silent):
    """What `host` sends is dropped where it leaves; what comes arrives. A queue with room for one byte takes nothing."""
    queue = ["tc", "-n", host, "qdisc", "replace" if silent else "del", "dev", CABLES[host], "root"]
    subprocess.run([*queue, *(["bfifo", "limit", "1"] if silent else [])], check=True)


def know_neighbours():
    """Or the side that is received would lose the other one's address, and the cable would fail both ways."""
    for host, other, address in ((PLANNER, ROBOT, "10.77.0.2"), (ROBOT, PLANNER, "10.77.0.1")):
        link = ip("-n", other, "link", "show", CABLES[other]).stdout.split("link/ether ")[1].split()[0]
        ip("-n", host, "neigh", "replace", address, "lladdr", link, "dev", CABLES[host], "nud", "permanent")


class Hosts:
    def __init__(self, folder):
        know_neighbours()
        self.operator, self.robot = Host(PLANNER, folder), Host(ROBOT, folder)
        self.operator.start("tandem_planner")
        self.controller = self.robot.start("tandem_controller", "--ros-args", "-p", "mode:=realtime", "-p", "state_timeout_s:=1.0")
        self.robot.start("tandem_sim_bridge", "--ros-args", "-p", "mode:=realtime", "-p", "real_time_factor:=0.33")
        for host in (self.operator, self.robot):
            host.ask(watch="/controller_state", type="tandem_msgs/msg/ControllerState")
        self.say(False)
        self.gaits = 0
        self.plan()
        wait_until(lambda: self.loaded() == 1, 40, "the first gait is across the cable")
        self.arm()

    def say(self, pressed):
        self.operator.ask(say="/emergency_stop", type="std_msgs/msg/Bool", fields={"data": pressed})

    def plan(self):
        assert self.operator.call("/generate_gait", "tandem_msgs/srv/GenerateGait", 60, behaviour="gait1")["success"]
        self.gaits += 1

    def loaded(self):
        return self.controller.text().count('gait "gait1"')

    def fault(self):
        states = self.robot.ask(received="/controller_state", fields=["fault"])
        return states[-1][1] if states else None

    def arm(self, seconds=40):
        began = time.monotonic()
        assert self.operator.call("/arm", "std_srvs/srv/Trigger", seconds)["success"]
        answered = time.monotonic() - began
        wait_until(lambda: self.fault() == "armed", 20, lambda: f"armed; it says {self.fault()}")
        return answered

    def outage(self, silent, seconds):
        """Seconds from when the cable is whole until states, a service, the gait and the stop are across it."""
        silence(silent, True)
        began = time.monotonic()
        if seconds >= 5:
            self.plan()
        time.sleep(max(0.0, began + seconds - time.monotonic()))
        silence(silent, False)
        whole = time.monotonic()
        self.say(True)
        latest = lambda: (self.operator.ask(received="/controller_state", fields=[]) or [[0]])[-1][0]
        took = {}
        checks = {"states": lambda: latest() > whole, "gait": lambda: self.loaded() >= self.gaits, "stop": lambda: "emergency_stop" in (self.fault() or "")}
        while len(took) < len(checks) and time.monotonic() < whole + 60:
            for name, check in checks.items():
                if name not in took and check():
                    took[name] = time.monotonic() - whole
            time.sleep(0.05)
        self.say(False)
        self.operator.call("/arm", "std_srvs/srv/Trigger", 60)  # answered, whatever it says while the stop is pressed
        took["service"] = time.monotonic() - whole
        self.operator.call("/disarm", "std_srvs/srv/Trigger", 60)
        time.sleep(1)
        self.arm()
        return took

    def close(self):
        self.operator.close()
        self.robot.close()


@pytest.fixture
def joined(hosts, tmp_path):  # noqa: F811
    joined = Hosts(tmp_path)
    yield joined
    joined.close()


def test_all_is_there_again_after_a_one_way_outage(joined):
    late = []
    for seconds in OUTAGES_S:
        for silent in (PLANNER, ROBOT):
            for _ in range(TIMES):
                took = joined.outage(silent, seconds)
                who = "operator" if silent == PLANNER else "robot"
                print(f"{who} not received for {seconds:.0f} s, then: " + ", ".join(f"{name} {value:.2f} s" for name, value in sorted(took.items())), flush=True)
                if len(took) < 4 or max(took.values()) > BACK_S:
                    late.append((who, seconds, took))
    assert not late, late
