"""The planner's service and action with rclpy's own clients: every path, several clients at once, answers of any length."""

import json
import threading
import time

import pytest
from conftest import ActionUser, Client, wait_until

# Out of its range, so that the search for the nearest request follows: the slowest answer there is.
HOPELESS = {"behaviour": "amble", "speed_m_s": [5.0]}
# Takes seconds to be refused: the solver tries before it gives up, and so does the search for what could be planned.
SLOW = {"behaviour": "amble", "half_width_m": [0.5]}


@pytest.fixture(scope="module")
def planner(processes, client):
    process = processes("tandem_planner", "--ros-args", "-r", "__ns:=/planning")
    yield process
    assert process.stop() == 0, process.text()


class Goals(ActionUser):
    """rclpy's action client, and what it receives."""

    def __init__(self, namespace):
        from tandem_msgs.action import GenerateGait

        super().__init__("goals", GenerateGait, f"{namespace}/generate_gait")

    def send(self, feedback=None, **fields):
        future = self.actions.send_goal_async(self.type.Goal(**fields), feedback_callback=feedback)
        wait_until(future.done, 20, "the goal is answered")
        return future.result()

    def result(self, handle, seconds=40):
        future = handle.get_result_async()
        wait_until(future.done, seconds, "the goal's result")
        return future.result()


@pytest.fixture
def goals(planner):
    goals = Goals("/planning")
    yield goals
    goals.close()


def test_a_goal_succeeds_with_feedback_for_every_iteration_and_its_gait_on_the_topic(client, goals):
    from action_msgs.msg import GoalStatus, GoalStatusArray
    from tandem_msgs.msg import Gait
    from test_walk import latched

    gaits, fed, called, statuses = [], [], [], []
    # What `ros2 action` and dashboards read.
    client.node.create_subscription(GoalStatusArray, "/planning/generate_gait/_action/status", statuses.append, latched())
    client.node.create_subscription(goals.type.Impl.FeedbackMessage, "/planning/generate_gait/_action/feedback", fed.append, 100)
    client.node.create_subscription(Gait, "/planning/gait", gaits.append, latched())
    # A writer sends nothing to a reader that it has not discovered.
    wait_until(lambda: goals.result(goals.send(behaviour="gait1")) and fed, 20, "feedback of a goal")
    handle = goals.send(lambda message: called.append(message.feedback), behaviour="amble", speed_m_s=[0.3])
    assert handle.accepted
    answer = goals.result(handle)
    assert answer.status == GoalStatus.STATUS_SUCCEEDED
    result = answer.result
    assert result.success and result.status == "converged" and result.solver.status == "converged"
    of_this = lambda: [message.feedback for message in fed if bytes(message.goal_id.uuid) == bytes(handle.goal_id.uuid)]
    numbers = lambda: [feedback.iteration for feedback in of_this()]
    wait_until(lambda: result.solver.iterations in numbers(), 5, lambda: f"{numbers()} of {result.solver.iterations}")
    received = of_this()
    assert numbers() == list(range(1, result.solver.iterations + 1))
    # Once rclpy's action client has the result, it drops the feedback that still lies in its reader.
    assert called and called == received[: len(called)], [feedback.iteration for feedback in called]
    assert received[-1].max_violation <= 1e-5 and received[0].max_violation > received[-1].max_violation
    assert all(later.elapsed_s > earlier.elapsed_s for earlier, later in zip(received, received[1:]))
    wait_until(lambda: any(gait.header.stamp == result.gait_stamp for gait in gaits), 5, "the gait on its topic")
    of_goal = lambda: [goal.status for message in statuses for goal in message.status_list if bytes(goal.goal_info.goal_id.uuid) == bytes(handle.goal_id.uuid)]
    wait_until(lambda: GoalStatus.STATUS_SUCCEEDED in of_goal(), 5, lambda: f"its end on the status topic: {of_goal()}")
    # A goal carries the service's fields.
    sloped = goals.result(goals.send(behaviour="amble", slope_rad=[0.05], reference="planned_joints")).result
    assert sloped.success and sloped.solver.objective != result.solver.objective
    wait_until(lambda: gaits[-1].header.stamp == sloped.gait_stamp, 5, "the gait on its topic")
    assert json.loads(gaits[-1].request_json)["slope_rad"] == 0.05
    assert gaits[-1].reference_coefficients_rad == gaits[-1].coefficients_rad
    # Who asks once more, and who asks late, receive the same.
    assert goals.result(handle).result == result


def test_an_invalid_goal_is_aborted_with_the_reason(goals):
    from action_msgs.msg import GoalStatus

    answer = goals.result(goals.send(behaviour="moonwalk"))
    assert answer.status == GoalStatus.STATUS_ABORTED
    assert not answer.result.success and answer.result.status == "invalid_request" and "moonwalk" in answer.result.message


def test_a_goal_is_cancelled_while_it_runs_and_while_it_waits(goals):
    from action_msgs.msg import GoalStatus
    from action_msgs.srv import CancelGoal

    running, waiting = goals.send(**SLOW), goals.send(behaviour="gait1")
    assert running.accepted and waiting.accepted
    for handle in (waiting, running):
        future = handle.cancel_goal_async()
        wait_until(future.done, 10, "the cancellation is answered")
        assert future.result().return_code == CancelGoal.Response.ERROR_NONE
        assert [bytes(goal.goal_id.uuid) for goal in future.result().goals_canceling] == [bytes(handle.goal_id.uuid)]
        began = time.monotonic()
        assert goals.result(handle).status == GoalStatus.STATUS_CANCELED
        # Given up, not run into the time limit of 20 s; a machine that is busy may take its time.
        assert time.monotonic() - began < 10
    again = running.cancel_goal_async()
    wait_until(again.done, 10, "the second cancellation is answered")
    assert again.result().return_code == CancelGoal.Response.ERROR_GOAL_TERMINATED
    assert goals.result(goals.send(behaviour="gait1")).status == GoalStatus.STATUS_SUCCEEDED


def test_a_request_that_cannot_be_planned_is_answered_in_fields_of_its_own(client, planner):
    from tandem_msgs.srv import GenerateGait

    plan = client.service(GenerateGait, "/planning/generate_gait")
    response = client.call(plan, GenerateGait.Request(**HOPELESS), 60)
    assert (response.success, response.status) == (False, "invalid_request")
    assert list(response.binding_constraints) == ["speed_m_s"]
    assert list(response.nearest_fields) == ["speed_m_s"]
    (speed,) = response.nearest_values
    assert 0.35 < speed < 5
    assert client.call(plan, GenerateGait.Request(behaviour="amble", speed_m_s=[speed])).success, "the proposal can be planned"
    # Within its range and yet too much: the limits that the nearest gait has reached.
    response = client.call(plan, GenerateGait.Request(behaviour="amble", speed_m_s=[2.0], step_duration_s=[0.6]), 60)
    assert not response.success and response.status != "invalid_request", response
    assert response.binding_constraints and response.nearest_fields and len(response.nearest_values) == len(response.nearest_fields)


EVERY_FIELD = {
    "step_duration_s": 0.36, "clearance_m": 0.1, "speed_m_s": 0.2, "height_m": 0.54, "half_width_m": 0.24, "slope_rad": 0.05,
    "friction": 0.5, "torque_limit_nm": [48.0, 49.0, 50.0],
}  # fmt: skip

# In short ones the torso keeps less to its pitch: within the program's 0.05 rad.
LONG_STEPS = {"step_duration_s": 0.4, "half_width_m": 0.25}


@pytest.mark.parametrize(
    "fields, degree",
    [
        (EVERY_FIELD, "mirrored"),
        ({"sideways_slope_rad": 0.05, **LONG_STEPS}, "two steps"),
        ({"torso_pitch_rad": 0.05}, "mirrored"),
        ({"torso_roll_rad": 0.04, **LONG_STEPS}, "two steps"),
    ],
    ids=["every number of the fast program", "sideways slope", "nose down", "leaned to the right"],
)
def test_every_field_of_a_request_reaches_the_gait(client, planner, fields, degree):
    from tandem_msgs.msg import Gait
    from tandem_msgs.srv import GenerateGait
    from test_walk import latched

    gaits = []
    subscription = client.node.create_subscription(Gait, "/planning/gait", gaits.append, latched())
    plan = client.service(GenerateGait, "/planning/generate_gait")
    lists = {name: value if isinstance(value, list) else [value] for name, value in fields.items()}
    response = client.call(plan, GenerateGait.Request(behaviour="gait1", **lists), 60)
    assert response.success, response.message
    wait_until(lambda: gaits and gaits[-1].header.stamp == response.gait_stamp, 10, "the gait on its topic")
    gait = gaits[-1]
    client.node.destroy_subscription(subscription)
    request = json.loads(gait.request_json)
    assert {name: request[name] for name in fields} == fields
    # And the plan is another one for it.
    assert len(gait.second_coefficients_rad) == (72 if degree == "two steps" else 0)
    pose, legs = gait.initial_base_pose, gait.initial_joint_position_rad
    pitch = lambda q: 2 * (q.w * q.y - q.z * q.x)
    roll = lambda q: 2 * (q.w * q.x + q.y * q.z)
    assert pitch(pose.orientation) == pytest.approx(fields.get("torso_pitch_rad", 0), abs=0.03)
    assert roll(pose.orientation) == pytest.approx(fields.get("torso_roll_rad", 0), abs=0.03)
    assert len(legs) == 12
    if fields is EVERY_FIELD:
        assert gait.step_duration_s == pytest.approx(0.36, rel=0.0101) and gait.step_length_m == pytest.approx(0.2 * gait.step_duration_s)
        assert list(gait.torque_limit_nm) and gait.solver.objective > 0
    own = client.call(plan, GenerateGait.Request(behaviour="gait1"), 60)
    assert own.solver.objective != response.solver.objective


def test_the_reference_is_the_one_that_was_asked_for(client, planner):
    from tandem_msgs.msg import Gait
    from tandem_msgs.srv import GenerateGait
    from test_walk import latched

    gaits = []
    client.node.create_subscription(Gait, "/planning/gait", gaits.append, latched())
    plan = client.service(GenerateGait, "/planning/generate_gait")

    def gait(reference):
        response = client.call(plan, GenerateGait.Request(behaviour="gait1", reference=reference), 60)
        assert response.success, response.message
        wait_until(lambda: gaits and gaits[-1].header.stamp == response.gait_stamp, 10, "the gait on its topic")
        return gaits[-1]

    own, compensated, joints, in_program = (gait(reference) for reference in ("", "compensated", "planned_joints", "in_program"))
    assert own.reference_coefficients_rad == compensated.reference_coefficients_rad != own.coefficients_rad
    assert joints.reference_coefficients_rad == joints.coefficients_rad == own.coefficients_rad
    # The full-order program's joints lag behind the reference as the law leaves them: near the other plan, and another
    # one.
    difference = max(abs(a - b) for a, b in zip(in_program.reference_coefficients_rad, own.reference_coefficients_rad, strict=True))
    assert 1e-6 < difference < 0.5, difference
    assert in_program.reference_coefficients_rad != in_program.coefficients_rad
    for reference, expected in (("planned", 'reference "planned" is unknown'), ("in_program ", "is unknown")):
        response = client.call(plan, GenerateGait.Request(behaviour="gait1", reference=reference))
        assert response.status == "invalid_request" and expected in response.message
    response = client.call(plan, GenerateGait.Request(behaviour="gait1", torque_limit_nm=[50.0]))
    assert response.status == "invalid_request" and "torque_limit_nm has 1 entries, expected 3" in response.message


def test_the_steps_from_standing_are_the_gait_s_lead_where_they_are_asked_for(client, planner):
    from tandem_msgs.msg import Gait
    from tandem_msgs.srv import GenerateGait
    from test_walk import latched

    gaits = []
    client.node.create_subscription(Gait, "/planning/gait", gaits.append, latched())
    plan = client.service(GenerateGait, "/planning/generate_gait")
    response = client.call(plan, GenerateGait.Request(behaviour="amble", from_rest=True), 60)
    assert response.success and "with a lead from standing" in response.message, response.message
    wait_until(lambda: gaits and gaits[-1].header.stamp == response.gait_stamp, 10, "the gait on its topic")
    lead = gaits[-1].lead
    assert (gaits[-1].version, len(lead), len(gaits[-1].cycle)) == (3, 2, 0)
    assert [list(domain.stance_legs) for domain in lead] == [[1, 2], [0, 3]]
    # It ends where the gait begins.
    ends = lambda rows: [rows[6 * joint + 5] for joint in range(12)]
    begins = lambda rows: [rows[6 * joint] for joint in range(12)]
    assert ends(lead[1].coefficients_rad) == pytest.approx(begins(gaits[-1].coefficients_rad), abs=0.02)


def test_the_same_request_gives_the_same_gait_whatever_was_asked_before(client, planner):
    from tandem_msgs.msg import Gait
    from tandem_msgs.srv import GenerateGait
    from test_walk import latched

    gaits = []
    client.node.create_subscription(Gait, "/planning/gait", gaits.append, latched())
    plan = client.service(GenerateGait, "/planning/generate_gait")

    def gait(**fields):
        response = client.call(plan, GenerateGait.Request(behaviour="amble", **fields), 60)
        assert response.success, response.message
        wait_until(lambda: gaits and gaits[-1].header.stamp == response.gait_stamp, 10, "the gait on its topic")
        gait = gaits[-1]
        gait.header.stamp.sec = gait.header.stamp.nanosec = 0
        gait.solver.solve_time_s = 0.0
        return gait

    first = gait()
    assert gait(slope_rad=[0.05]) != first
    assert client.call(plan, GenerateGait.Request(behaviour="amble", half_width_m=[0.5]), 60).success is False
    assert gait() == first


def test_a_hundred_requests_in_a_row_are_answered(client, planner):
    from tandem_msgs.srv import GenerateGait

    plan = client.service(GenerateGait, "/planning/generate_gait")
    began = time.monotonic()
    stamps = set()
    for number in range(100):
        response = client.call(plan, GenerateGait.Request(behaviour="amble", speed_m_s=[0.3 + 0.001 * (number % 50)]))
        assert response.success, response.message
        assert response.step_length_m == pytest.approx((0.3 + 0.001 * (number % 50)) * response.step_duration_s, rel=1e-3)
        stamps.add((response.gait_stamp.sec, response.gait_stamp.nanosec))
    assert len(stamps) == 100
    print(f"100 requests in {time.monotonic() - began:.2f} s")


def test_four_clients_at_once_are_answered_while_one_asks_the_impossible(client, planner):
    from tandem_msgs.srv import GenerateGait

    slowest, failures = [0.0] * 4, []
    others = [Client(f"caller_{number}") for number in range(4)]
    services = [other.service(GenerateGait, "/planning/generate_gait") for other in others]

    def caller(number):
        try:
            for turn in range(15):
                began = time.monotonic()
                fields = HOPELESS if number == 0 and turn == 0 else {"behaviour": ["gait1", "gait2", "gait3", "amble"][number]}
                response = others[number].call(services[number], GenerateGait.Request(**fields), 60)
                assert response.success != (fields is HOPELESS), response.message
                slowest[number] = max(slowest[number], time.monotonic() - began)
        except BaseException as failure:  # a thread's failure is the test's
            failures.append(failure)

    threads = [threading.Thread(target=caller, args=[number]) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for other in others:
        other.close()
    assert not failures, failures
    print("slowest answer of each client:", ", ".join(f"{seconds:.3f} s" for seconds in slowest))
    assert max(slowest[1:]) < max(1.0, 0.5 * slowest[0]), f"held up by the impossible: {slowest}"


def test_a_program_that_made_and_ended_hundreds_of_endpoints_is_answered(planner):
    """Its announcements take long to read, and are read again while one of its endpoints may have ended: what is new comes last."""
    import rclpy
    from rclpy.action import ActionClient
    from tandem_msgs.action import GenerateGait

    aside = rclpy.create_node("restless")
    for _ in range(250):
        ActionClient(aside, GenerateGait, "/planning/generate_gait").destroy()
    slowest = 0.0
    for _ in range(10):
        began = time.monotonic()
        goals = Goals("/planning")
        assert goals.result(goals.send(behaviour="moonwalk")).result.status == "invalid_request"
        slowest = max(slowest, time.monotonic() - began)
        goals.close()
    print(f"slowest answer: {slowest:.2f} s")
    aside.destroy_node()


def test_gaits_are_stamped_by_the_simulations_clock_where_it_is_asked_for(client, processes):
    from rosgraph_msgs.msg import Clock
    from tandem_msgs.srv import GenerateGait
    from test_walk import best_effort, seconds

    arguments = ["-r", "__ns:=/simulated", "-r", "/clock:=/simulated/clock", "-p", "use_sim_time:=true"]
    process = processes("tandem_planner", "--ros-args", *arguments)
    clock = client.node.create_publisher(Clock, "/simulated/clock", best_effort(1))
    generate = client.service(GenerateGait, "/simulated/generate_gait")

    def stamp_at(time_s):
        """Of a gait planned while the clock says this; before it is received it is 0 there."""
        message, deadline = Clock(), time.monotonic() + 20
        message.clock.sec, message.clock.nanosec = int(time_s), int(1e9 * (time_s % 1))
        while time.monotonic() < deadline:
            clock.publish(message)
            time.sleep(0.05)
            answer = client.call(generate, GenerateGait.Request(behaviour="gait1"))
            assert answer.success, answer.message
            if seconds(answer.gait_stamp) >= time_s:
                return answer.gait_stamp
        raise AssertionError(f"no gait is stamped {time_s}: {answer.gait_stamp}")

    first = stamp_at(1234.5)
    assert (first.sec, first.nanosec) == (1234, 500_000_000)
    # Time stands still, and an answer still names its own gait.
    second = client.call(generate, GenerateGait.Request(behaviour="gait1")).gait_stamp
    assert (second.sec, second.nanosec) == (1234, 500_000_001)
    assert stamp_at(2000.0).sec == 2000
    assert process.stop() == 0


def test_what_is_too_much_is_refused_with_a_reason(client, processes):
    from tandem_msgs.srv import GenerateGait

    arguments = ["-p", "waiting_requests:=0", "-p", "parallel_requests:=1"]
    processes("tandem_planner", "--ros-args", "-r", "__ns:=/crowded", *arguments)
    plan = client.service(GenerateGait, "/crowded/generate_gait")
    goals = Goals("/crowded")
    others = [Client(f"crowd_{number}") for number in range(3)]
    services = [other.service(GenerateGait, "/crowded/generate_gait") for other in others]
    first = plan.call_async(GenerateGait.Request(**SLOW))
    time.sleep(0.1)
    futures = [service.call_async(GenerateGait.Request(behaviour="gait1")) for service in services]
    wait_until(lambda: all(future.done() for future in [first, *futures]), 40, "everyone is answered")
    assert all(not future.result().success and future.result().status == "busy" for future in futures)
    assert all("wait already" in future.result().message for future in futures)
    running = goals.send(**SLOW)
    assert running.accepted and not goals.send(behaviour="gait1").accepted
    running.cancel_goal_async()
    goals.result(running)
    goals.close()
    for other in others:
        other.close()


def test_answers_longer_than_a_datagram_arrive(client, processes):
    """As `ros2 param dump` asks: all parameters at once, of the node that has most."""
    from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters
    from rclpy.serialization import serialize_message

    processes("tandem_controller", "--ros-args", "-r", "__ns:=/verbose")
    ask = lambda kind, name, request: client.call(client.service(kind, f"/verbose/controller/{name}"), request)
    names = ask(ListParameters, "list_parameters", ListParameters.Request()).result.names
    values = ask(GetParameters, "get_parameters", GetParameters.Request(names=names))
    descriptions = ask(DescribeParameters, "describe_parameters", DescribeParameters.Request(names=names))
    assert len(serialize_message(values)) > 1400 and len(serialize_message(descriptions)) > 3000
    assert len(values.values) == len(names) and all(value.type for value in values.values)
    assert [descriptor.name for descriptor in descriptions.descriptors] == list(names)
