"""Over DDS in lockstep, in balance: where cmd_vel stays far from what the gait was planned for, the controller asks the planner for another."""

import json
import subprocess

import pytest
from conftest import ROOT, wait_until
from test_drive import driven, means, since, walk_for


@pytest.fixture
def planned_for(processes, ros, tmp_path):
    parameters = ["plan_for_cmd_vel:=true", "plan_for_cmd_vel_far_m_s:=0.1"]
    yield from driven(processes, ros, tmp_path, *parameters)


def speeds(robot):
    """What the gaits on the topic were planned for."""
    return [json.loads(gait.request_json)["speed_m_s"] for gait in robot.gaits]


def test_a_gait_is_planned_for_what_is_driven_and_without_a_planner_it_walks_on(planned_for, tmp_path):
    from diagnostic_msgs.msg import DiagnosticArray
    from tandem_msgs.srv import StartRecording, StopRecording

    robot = planned_for
    planner, controller = robot.nodes[:2]
    said = []
    robot.client.node.create_subscription(
        DiagnosticArray, "/diagnostics",
        lambda message: said.extend(v.value for s in message.status for v in s.values if v.key == "plan_for_cmd_vel"), 10)  # fmt: skip
    assert robot.generate(behaviour="gait1").success
    robot.wait(lambda: robot.gaits, 10, "the gait")
    start = robot.service(StartRecording, "start_recording")
    assert robot.client.call(start, StartRecording.Request(folder="planned")).success
    for request in ("arm", "stand", "walk"):
        robot.trigger(request)
    robot.driver.ask(0.35, 0.0, 0.0)
    robot.pause(False)
    robot.wait(lambda: robot.mode() == "walking", 90, "walking")
    walking_from = len(robot.states)

    # Gait1 steps in place. No gait is further from the one before than a fifth of the robot's greatest speed.
    robot.wait(lambda: speeds(robot)[-1] > 0.3, 120, "a gait for 0.35 m/s")
    assert speeds(robot) == [0.0, pytest.approx(0.2, abs=0.01), pytest.approx(0.35, abs=1e-6)]
    wait_until(lambda: said and "planned for 0.35 m/s" in said[-1], 30, lambda: f"{said[-3:]}\n{controller.text()}")
    walk_for(robot, 2, "taking it up")
    ahead, left, turning = means(since(robot.truth, walk_for(robot, 4, "driving")))
    print(f"asked for 0.35 m/s: {ahead:.3f} {left:.3f} {turning:.3f}")
    assert (ahead, left, turning) == (pytest.approx(0.35, abs=0.08), pytest.approx(0, abs=0.04), pytest.approx(0, abs=0.06))

    # Without a planner another command is walked as ever, and why with this gait is said once.
    planner.process.kill()
    planner.process.wait()
    robot.nodes.remove(planner)
    robot.driver.ask(0.0, 0.0, 0.0)
    wait_until(lambda: "no gait for cmd_vel" in controller.text(), 60, controller.text)
    walk_for(robot, 14, "in place, asking once more")
    assert all(abs(value) < 0.05 for value in means(since(robot.truth, walk_for(robot, 3, "in place"))))
    assert controller.text().count("no gait for cmd_vel") == 1, controller.text()
    assert said[-1].startswith("walks on with the gait that it has"), said[-1]
    assert {state.mode for state in robot.states[walking_from:]} == {"walking"}, "it stopped for a gait"

    # What was loaded is walked next.
    robot.trigger("stop")
    robot.wait(lambda: robot.mode() == "standing", 60, "standing")
    wait_until(lambda: "the walk is over: gait \"gait1\"" in controller.text(), 20, controller.text)
    stop = robot.service(StopRecording, "stop_recording")
    assert robot.client.call(stop, StopRecording.Request()).success
    verified = subprocess.run([ROOT / "target/release/tandem", "bag", "verify", tmp_path / "planned"], capture_output=True, text=True)
    print(verified.stdout)
    assert verified.returncode == 0 and "to the bit" in verified.stdout, verified.stdout + verified.stderr
