"""No answer is lost because its caller is not known yet, and none holds up the others. The callers are Cyclone DDS's: a client in parts,
of which the reader of answers is made late, or never."""

import os
import pathlib
import signal
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from conftest import DOMAIN, TARGET, Process, wait_until
from test_cyclone import Cyclone

SILENT = 20


@pytest.fixture(scope="module")
def server(processes):
    process = processes("examples/exercise", "--ros-args", "-r", "__ns:=/answers", name="exercise-answers")
    wait_until(lambda: "ready" in process.text(), 20, "exercise is ready")
    return process


class PartsOfAClient(Cyclone):
    """A client of the exercise's service `count` (std_srvs/SetBool), whose two halves are made one by one."""

    def __init__(self, server):
        from cyclonedds.idl import make_idl_struct
        from cyclonedds.pub import DataWriter
        from cyclonedds.topic import Topic

        assert server.alive()
        super().__init__()
        request = make_idl_struct("SetBool_Request_", "std_srvs.srv.dds_.SetBool_Request_", {"data": bool})
        self.answer = make_idl_struct("SetBool_Response_", "std_srvs.srv.dds_.SetBool_Response_", {"success": bool, "message": str})
        self.request = request(data=True)
        self.writer = DataWriter(self.participant, Topic(self.participant, "rq/answers/countRequest", request), qos=self.qos["reliable"])
        wait_until(self.writer.get_matched_subscriptions, 20, "the service takes requests")

    def ask(self):
        self.writer.write(self.request)

    def listen(self):
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic

        return DataReader(self.participant, Topic(self.participant, "rr/answers/countReply", self.answer), qos=self.qos["reliable"])


def test_an_answer_waits_until_its_caller_is_known(server):
    def answered():
        client = PartsOfAClient(server)
        client.ask()
        # The server has long answered, if it does not wait.
        time.sleep(0.3)
        reader, deadline = client.listen(), time.monotonic() + 5
        while time.monotonic() < deadline:
            for sample in reader.take():
                return sample
            time.sleep(0.01)
        return None

    # The server waits for a second: on a busy machine the late reader may be later than that.
    answers = (answered() for _ in range(3))
    assert any(answer is not None and answer.success for answer in answers), server.text()


def test_nobody_waits_behind_an_answer_that_waits(server, client):
    from std_srvs.srv import SetBool

    service = client.service(SetBool, "/answers/count")
    calls = lambda: int(client.call(service, SetBool.Request(data=True)).message)
    before, silent = calls(), PartsOfAClient(server)
    for _ in range(SILENT):
        silent.ask()
    slowest, taken, own, deadline = 0.0, 0, 0, time.monotonic() + 10
    while taken < SILENT and time.monotonic() < deadline:
        began = time.monotonic()
        own += 1
        taken = calls() - before - own
        slowest = max(slowest, time.monotonic() - began)
    print(f"{taken} calls of a client that does not listen taken; of {own} of another the slowest answer took {slowest:.3f} s")
    assert taken == SILENT, "the silent client's requests are taken"
    # One behind the other the answers to the silent client would take a second each.
    assert slowest < 0.9


def test_a_client_that_calls_at_once_is_answered(processes, client):
    """As fast as rclpy lets one call, at nodes that have just started: `wait_for_service` says only that the server is known here."""
    from rcl_interfaces.srv import GetParameters

    for number in range(5):
        process = processes("examples/exercise", "--ros-args", "-r", f"__ns:=/at_once_{number}", "-p", "gain:=2.5")
        service = client.node.create_client(GetParameters, f"/at_once_{number}/exercise/get_parameters")
        assert service.wait_for_service(20)
        assert client.call(service, GetParameters.Request(names=["gain"]), 10).values[0].double_value == 2.5
        client.node.destroy_client(service)
        assert process.stop() == 0


def test_a_node_that_is_asked_to_end_while_it_starts_ends_orderly(tmp_path):
    """Twenty times SIGTERM as soon as anything of the node can be seen from outside: that its participant has its port."""
    of_domain = range(7400 + 250 * DOMAIN, 7400 + 250 * (DOMAIN + 1))

    def has_its_port(pid):
        sockets = [line.split() for line in open("/proc/net/udp").read().splitlines()[1:]]
        of_nodes = {f"socket:[{socket[9]}]" for socket in sockets if int(socket[1].split(":")[1], 16) in of_domain}
        return any(file.is_symlink() and os.readlink(file) in of_nodes for file in pathlib.Path(f"/proc/{pid}/fd").iterdir())

    def started_and_ended(number):
        arguments = ["--ros-args", "-r", f"__ns:=/ending_{number}"]
        process = Process(TARGET / "examples/exercise", arguments, tmp_path / f"{number}.log")
        wait_until(lambda: has_its_port(process.process.pid), 20, "its participant")
        time.sleep(0.05 * (number % 4))
        began = time.monotonic()
        code = process.stop(signal.SIGTERM)
        return code, process.text(), time.monotonic() - began

    with ThreadPoolExecutor(4) as threads:
        ends = list(threads.map(started_and_ended, range(20)))
    assert [code for code, _, _ in ends] == [0] * 20, ends
    assert all("panic" not in text and "ERROR" not in text for _, text, _ in ends), ends
