"""What a remote may do on the controller's machine: texts that would fake log lines, recordings that would leave their folder, more
requests and parameters than a node takes."""

import os
import re

import pytest
from conftest import wait_until
from test_walk import latched

SPOILED = "trot\n2026-01-01T00:00:00.000000Z  INFO armed\x1b[2J\r\u202e"


@pytest.fixture(scope="module")
def controller(processes, tmp_path_factory):
    root = tmp_path_factory.mktemp("bounds") / "recordings"
    process = processes("tandem_controller", "--ros-args", "-r", "__ns:=/bounds", "-p", "mode:=lockstep", "-p", f"record_root:={root}")
    process.root = root
    return process


def no_trick(text):
    return not re.search(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e]", text)


def test_a_name_with_a_newline_fakes_no_line_of_the_log(client, controller):
    from rcl_interfaces.msg import Parameter
    from rcl_interfaces.srv import SetParameters
    from tandem_msgs.msg import Gait
    from tandem_msgs.srv import ClearFault, LoadGait, StartRecording

    call = lambda kind, service, **fields: client.call(client.service(kind, f"/bounds/{service}"), kind.Request(**fields))
    answers = [
        call(ClearFault, "clear_fault", name=SPOILED).message,
        call(StartRecording, "start_recording", folder=SPOILED).message,
        call(LoadGait, "load_gait", json='{"format": "' + SPOILED.encode("unicode_escape").decode().replace("\\x1b", "\\u001b") + '", "version": 1}').message,
        call(SetParameters, "controller/set_parameters", parameters=[Parameter(name=SPOILED)]).results[0].reason,
    ]  # fmt: skip
    gaits = client.node.create_publisher(Gait, "/bounds/gait", latched())
    wait_until(lambda: gaits.get_subscription_count() == 1, 20, "the topic gait has a subscriber")
    gaits.publish(Gait(name=SPOILED * 100))
    wait_until(lambda: re.search("gait .*refused", controller.text()), 20, controller.text)
    assert all(no_trick(answer) and "armed" in answer for answer in answers), answers
    text = controller.text()
    # Every line begins as the node's own do, and none of them is the forged one.
    assert all(no_trick(line) and re.match(r"\d{4}-\d\d-\d\dT\S+Z +[A-Z]+ ", line) for line in text.splitlines()), text
    assert not any(line.startswith("2026-01-01T00:00:00.000000Z") for line in text.splitlines()), text
    assert max(map(len, text.splitlines())) < 4100, "a line is as long as somebody else likes"


def test_a_recording_leaves_its_folder_by_no_name(client, controller, tmp_path):
    from tandem_msgs.srv import StartRecording, StopRecording

    begin, end = client.service(StartRecording, "/bounds/start_recording"), client.service(StopRecording, "/bounds/stop_recording")
    controller.root.mkdir(exist_ok=True)
    (controller.root / "link").symlink_to(tmp_path)
    for name in ("", "..", "../out", str(tmp_path / "run"), "a/b", ".hidden", "link", "link/run", "x" * 65):
        answer = client.call(begin, StartRecording.Request(folder=name))
        assert not answer.success and answer.message, name
    assert os.listdir(tmp_path) == [] and os.listdir(controller.root) == ["link"]
    assert client.call(begin, StartRecording.Request(folder="monday-1.2_x")).success
    ended = client.call(end, StopRecording.Request())
    assert ended.success and ended.folder == str(controller.root / "monday-1.2_x"), ended


def test_more_requests_than_may_wait_learn_that_the_node_is_busy_and_the_stop_is_obeyed(client, controller):
    from std_srvs.srv import SetBool, Trigger

    # Nobody publishes joint states: each request waits for the cycle, so that the others pile up behind it.
    stand = client.service(Trigger, "/bounds/stand", depth=200)
    stop = client.service(SetBool, "/bounds/emergency_stop")
    asked = [stand.call_async(Trigger.Request()) for _ in range(100)]
    answered = lambda: [future.result().message for future in asked if future.done()]
    # One is being answered, 64 wait.
    wait_until(lambda: sum("busy" in message for message in answered()) >= 20, 10, lambda: f"{answered()}")
    pressed = client.call(stop, SetBool.Request(data=True), 5)
    assert pressed.success and "damped" in pressed.message, pressed
    assert not all(future.done() for future in asked), "the others wait, they were not dropped"
    wait_until(lambda: all(future.done() for future in asked), 60, lambda: f"{len(answered())} of {len(asked)} answered")
    assert 20 <= sum("busy" in message for message in answered()) <= 40, answered()
