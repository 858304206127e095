"""claim and release: while one program has claimed the robot, the others' requests to move it are refused by its name."""

import subprocess
import sys
import time

import pytest
from conftest import ROOT, wait_until

NAMESPACE = "/leased"
# Another program: it does what lines on its standard input say.
PROGRAM = f"""
import sys
import rclpy
from geometry_msgs.msg import Pose, Twist
from std_srvs.srv import Trigger
from tandem_msgs.srv import Claim

rclpy.init()
node = rclpy.create_node("laptop")
publishers = {{}}
for line in sys.stdin:
    service, *values = line.split()
    if service == "publish":
        # Neither can be meant: where it is heeded, diagnostics say what is wrong with it.
        bad = Pose() if values[0] == "body_pose" else Twist()
        (bad.position if values[0] == "body_pose" else bad.linear).x = float("nan")
        publisher = publishers.setdefault(values[0], node.create_publisher(type(bad), "{NAMESPACE}/" + values[0], 10))
        publisher.publish(bad)
        print("yes", flush=True)
        continue
    claims = service == "claim"
    client = node.create_client(Claim if claims else Trigger, "{NAMESPACE}/" + service)
    assert client.wait_for_service(20)
    request = Claim.Request(name=values[0], duration_s=float(values[1]), take=values[2] == "take") if claims else Trigger.Request()
    future = client.call_async(request)
    rclpy.spin_until_future_complete(node, future, timeout_sec=20)
    print("yes" if future.result().success else "no", future.result().message, flush=True)
    node.destroy_client(client)
rclpy.shutdown()
"""


class Laptop:
    def __init__(self):
        self.process = subprocess.Popen([sys.executable, "-c", PROGRAM], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT)

    def ask(self, line):
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()
        success, _, message = self.process.stdout.readline().strip().partition(" ")
        return success == "yes", message

    def leave(self):
        self.process.stdin.close()
        assert self.process.wait(20) == 0


@pytest.fixture(scope="module")
def controller(processes):
    controller = processes("tandem_controller", "--ros-args", "-r", f"__ns:={NAMESPACE}", "-p", "balance:=true")
    yield controller
    assert controller.stop() == 0, controller.text()


@pytest.fixture
def laptop(controller):
    laptop = Laptop()
    yield laptop
    if laptop.process.poll() is None:
        laptop.leave()


@pytest.fixture(scope="module")
def ask(controller, client):
    from std_srvs.srv import SetBool, Trigger
    from tandem_msgs.srv import Claim, ClearFault, LoadGait

    types = {"claim": Claim, "clear_fault": ClearFault, "load_gait": LoadGait, "emergency_stop": SetBool}
    clients = {}

    def ask(name, /, **fields):
        type_ = types.get(name, Trigger)
        if name not in clients:
            clients[name] = client.service(type_, f"{NAMESPACE}/{name}")
        answer = client.call(clients[name], type_.Request(**fields))
        return answer.success, answer.message

    return ask


# What it reports when it would move the robot, beside a lease or without: it has no joint states here.
MOVES = [("arm", {}), ("stand", {}), ("sit", {}), ("walk", {}), ("clear_fault", {"name": "tilt"}), ("load_gait", {"json": "{}"})]


def refused_by(ask, name):
    """Which of the requests to move are refused because this name has claimed the robot."""
    return [service for service, fields in MOVES if f'claimed by "{name}"' in ask(service, **fields)[1]]


def test_while_one_program_drives_the_others_are_refused_by_its_name(ask, laptop):
    everything = [service for service, _ in MOVES]
    assert not any("claimed" in ask(service, **fields)[1] for service, fields in MOVES), "nobody has claimed it"
    assert laptop.ask("claim laptop 0 -") == (True, 'claimed by "laptop" until it is released')
    assert refused_by(ask, "laptop") == everything
    assert "claimed" not in laptop.ask("arm")[1] and "claimed" not in laptop.ask("walk")[1]
    # To stop is everybody's.
    for service, fields in (("stop", {}), ("disarm", {}), ("emergency_stop", {"data": True}), ("emergency_stop", {"data": False})):
        assert "claimed" not in ask(service, **fields)[1], service
    assert ask("release") == (False, 'claimed by "laptop" until it is released, which alone releases it')
    assert not ask("claim", name="tablet")[0]
    # Taken on purpose, the other one is refused.
    assert ask("claim", name="tablet", take=True) == (True, 'claimed by "tablet" until it is released, taken from "laptop"')
    assert 'claimed by "tablet"' in laptop.ask("arm")[1]
    assert refused_by(ask, "tablet") == []
    assert ask("release")[0] and "claimed" not in laptop.ask("arm")[1]


def test_a_claim_ends_with_its_time_with_its_program_and_with_deactivation(ask, laptop, client):
    from lifecycle_msgs.msg import Transition
    from lifecycle_msgs.srv import ChangeState

    begun = time.monotonic()
    assert laptop.ask("claim laptop 2.0 -")[0] and refused_by(ask, "laptop")
    wait_until(lambda: not refused_by(ask, "laptop"), 10, "the claim's end")
    assert time.monotonic() - begun > 1.5
    # Deactivated and active again, nobody holds it.
    assert laptop.ask("claim laptop 0 -")[0] and refused_by(ask, "laptop")
    change = client.service(ChangeState, f"{NAMESPACE}/controller/change_state")
    for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVATE):
        assert client.call(change, ChangeState.Request(transition=Transition(id=transition))).success
    assert not refused_by(ask, "laptop")
    # The program ends.
    assert laptop.ask("claim laptop 0 -")[0] and refused_by(ask, "laptop")
    laptop.leave()
    wait_until(lambda: not refused_by(ask, "laptop"), 10, "the claim's end")


@pytest.mark.parametrize("topic", ["cmd_vel", "body_pose"])
def test_while_it_is_claimed_its_holder_alone_moves_it_by_a_topic(ask, laptop, client, topic):
    """Heeded or not is told apart by what diagnostics say of a message that is wrong in itself."""
    from diagnostic_msgs.msg import DiagnosticArray

    said = []

    def listen(array):
        said.extend(status.message for status in array.status if status.name == f"{NAMESPACE}/controller: inputs")

    subscription = client.node.create_subscription(DiagnosticArray, "/diagnostics", listen, 10)
    looked_at, refused = f"{topic}: refused: ", f'lease: {topic} of another program refused: claimed by "'

    def published(expected, never):
        def seen():
            laptop.ask(f"publish {topic}")
            return any(expected in message for message in said)

        # Diagnostics of a second ago speak of what was before.
        time.sleep(2.5)
        said.clear()
        wait_until(seen, 20, lambda: (expected, said))
        assert not any(never in message for message in said), said

    published(looked_at, refused)
    assert laptop.ask("claim laptop 0 -")[0]
    published(looked_at, refused)
    assert ask("claim", name="tablet", take=True)[0]
    published(refused + "tablet", looked_at)
    assert ask("release")[0]
    published(looked_at, refused)
    client.node.destroy_subscription(subscription)


def test_a_claim_that_cannot_be_meant_is_refused(ask):
    for fields in ({"name": ""}, {"name": "x" * 65}, {"name": "a\nb"}, {"name": "x", "duration_s": -1.0}, {"name": "x", "duration_s": float("nan")}):
        success, message = ask("claim", **fields)
        assert not success and "expected" in message, (fields, message)
    assert not any("claimed" in ask(service, **fields)[1] for service, fields in MOVES)
