"""Processes that die while the robot walks, over DDS in realtime: what the others do, and how many control cycles (1 ms) it takes
until the robot is safe.

Cycles are counted on the simulation's stamps. The timeouts are ten times the usual ones, because a machine that runs tests can
stand still for some tenths of a second; the bound is the timeout, whatever it is.
"""

import collections
import signal
import threading
import time

import pytest
from conftest import Client, wait_until
from test_walk import best_effort, seconds

# A killed node stays in others' graphs for a while: the tests after these must not meet it.
NAMESPACE = "/killed"
CYCLE_S = 0.001
# command_timeout_s of the bridge and state_timeout_s of the controller: what is not received for so long means damping.
TIMEOUT_CYCLES = 1000
# From a look at the newest stamp to the process's end: wall time, in simulated cycles.
SLACK_CYCLES = 80
# Between two messages of controller_state.
STATE_CYCLES = 20
# A drive without commands gives -kd v; the velocity that is reported is that after the physics step.
DAMPING_NM_S_PER_RAD = 5.0
DAMPING_TOLERANCE_NM = 1.5


class Robot:
    """The nodes in realtime, each to be killed by itself, and every joint state and controller state that was received."""

    def __init__(self, processes, ros):
        from sensor_msgs.msg import JointState
        from tandem_msgs.msg import ControllerState

        self.processes, self.ros = processes, ros
        self.planner = self.start("tandem_planner")
        self.controller = self.start_controller()
        self.bridge = self.start("tandem_sim_bridge", f"command_timeout_s:={TIMEOUT_CYCLES * CYCLE_S}")
        self.client = Client("watcher")
        self.states = []
        self.client.node.create_subscription(ControllerState, f"{NAMESPACE}/controller_state", self.states.append, 100)
        self.aside = ros.create_node("aside_killed")
        self.subscription = self.aside.create_subscription(JointState, f"{NAMESPACE}/joint_states", print, best_effort(1000))
        self.joints = collections.deque(maxlen=5000)
        self.watching = True
        self.watcher = threading.Thread(target=self._watch, daemon=True)
        self.watcher.start()

    def start(self, program, *parameters):
        chosen = [part for parameter in parameters for part in ("-p", parameter)]
        return self.processes(program, "--ros-args", "-r", f"__ns:={NAMESPACE}", *chosen)

    def start_controller(self):
        timeout_s = TIMEOUT_CYCLES * CYCLE_S
        timeouts = [f"{name}:={timeout_s}" for name in ("state_timeout_s", "overrun_s", "middleware_timeout_s")]
        return self.start("tandem_controller", *timeouts, "posture_speed_rad_s:=2.0")

    def _watch(self):
        # Quicker than an executor.
        while self.watching:
            with self.subscription.handle:
                taken = self.subscription.handle.take_message(self.subscription.msg_type, False)
            if taken is None:
                time.sleep(0.0005)
            else:
                self.joints.append((round(seconds(taken[0].header.stamp) / CYCLE_S), list(taken[0].velocity), list(taken[0].effort)))

    def service(self, type_, name):
        return self.client.service(type_, f"{NAMESPACE}/{name}")

    def trigger(self, name):
        from std_srvs.srv import Trigger

        response = self.client.call(self.service(Trigger, name), Trigger.Request())
        assert response.success, f"{name}: {response.message}"

    def mode(self):
        return self.states[-1].mode if self.states else None

    def wait_for(self, mode, wall_seconds=60):
        wait_until(lambda: self.mode() == mode, wall_seconds, lambda: f"{mode}; it is {self.states[-1:]}")

    def walk(self):
        """From disarmed or from a fault to walking."""
        from tandem_msgs.srv import ClearFault

        if self.mode() != "disarmed":
            self.trigger("disarm")
            self.wait_for("disarmed")
        self.trigger("reset")
        since = self.cycle()
        wait_until(lambda: self.cycle() > since + 300, 10, "the robot at rest")
        clear = self.service(ClearFault, "clear_fault")
        for fault in filter(None, self.states[-1].fault.split(",")):
            assert self.client.call(clear, ClearFault.Request(name=fault)).success
        for request in ("arm", "stand", "walk"):
            self.trigger(request)
        self.wait_for("walking")
        self.walks_on(1.0)

    def cycle(self):
        """The newest joint state's."""
        return self.joints[-1][0]

    def walks_on(self, simulated_s):
        until = self.cycle() + simulated_s / CYCLE_S
        wait_until(lambda: self.cycle() >= until or self.mode() != "walking", 60, "simulated time goes on")
        assert self.mode() == "walking", self.states[-1]

    def drives_damp_from(self, since):
        """The first of five joint states on end in which every drive gives -kd v."""

        def damp(state):
            _, velocity, effort = state
            return all(abs(e + DAMPING_NM_S_PER_RAD * v) < DAMPING_TOLERANCE_NM for v, e in zip(velocity, effort))

        later = [state for state in list(self.joints) if state[0] > since]
        for at in range(len(later) - 4):
            if all(damp(state) for state in later[at : at + 5]):
                return later[at][0]
        return None

    def safe_states(self):
        return [state for state in list(self.states) if state.mode in ("damping", "fault")]

    def close(self):
        self.watching = False
        self.watcher.join()
        self.aside.destroy_node()
        self.client.close()
        for process in (self.planner, self.controller, self.bridge):
            if process.alive():
                kill(process)


@pytest.fixture(scope="module")
def robot(processes, ros):
    from tandem_msgs.srv import GenerateGait

    robot = Robot(processes, ros)
    wait_until(lambda: robot.joints and robot.states, 30, "joint states and controller_state")
    answer = robot.client.call(robot.service(GenerateGait, "generate_gait"), GenerateGait.Request(behaviour="amble"), 60)
    assert answer.success, answer.message
    wait_until(lambda: robot.states[-1].gait == "amble", 10, "the gait at the controller")
    yield robot
    robot.close()


def kill(process):
    process.process.send_signal(signal.SIGKILL)
    process.process.wait()


def test_the_controller_killed_while_walking(robot):
    """The drives damp by themselves; the controller comes back disarmed and walks again when it is asked to."""
    robot.walk()
    since = robot.cycle()
    kill(robot.controller)
    safe = wait_until(lambda: robot.drives_damp_from(since), 30, "damping")
    print(f"controller killed: the drives damp after {safe - since} cycles")
    assert safe - since <= TIMEOUT_CYCLES + SLACK_CYCLES
    robot.states.clear()
    robot.controller = robot.start_controller()
    wait_until(lambda: robot.states, 20, "controller_state")
    assert robot.states[0].mode == "disarmed"
    wait_until(lambda: robot.states[-1].gait == "amble", 20, "the latched gait at the new controller")
    since = robot.cycle()
    wait_until(lambda: robot.cycle() > since + 50, 10, "joint states")
    assert robot.joints[-1][2] == [0.0] * 12, "the drives are at rest under a controller that has just come back"
    robot.walk()


def test_the_planner_killed_while_walking(robot):
    kill(robot.planner)
    robot.walks_on(2.0)


def test_a_reset_while_walking_is_an_encoder_jump_and_no_clock_jump(robot):
    """The simulation's time goes on over a reset; only the joints jump."""
    since = robot.cycle()
    robot.trigger("reset")
    wait_until(lambda: robot.mode() == "fault", 20, "a fault")
    assert robot.states[-1].fault == "encoder_jump", robot.states[-1].fault
    assert min(cycle for cycle, _, _ in robot.joints) <= since <= robot.cycle()
    robot.walk()


def test_a_second_publisher_of_joint_states_is_a_clock_jump(robot):
    """Another simulation in the domain, whose time is another: its stamps lie before those of the first."""
    from builtin_interfaces.msg import Time
    from sensor_msgs.msg import JointState

    newest = []
    subscription = robot.client.node.create_subscription(JointState, f"{NAMESPACE}/joint_states", newest.append, best_effort(1))
    second = robot.client.node.create_publisher(JointState, f"{NAMESPACE}/joint_states", 10)
    wait_until(lambda: newest and second.get_subscription_count() >= 3, 20, "joint states and who listens to them")
    assert robot.mode() == "walking"
    message = newest[-1]
    assert seconds(message.header.stamp) > 2.0
    message.header.stamp = Time(sec=1)

    # controller_state counts the controller's own cycles; a change of mode is published at once. The controller's side
    # of the match follows the publisher's: what is published before that is not received, and is published again.
    def said_and_noticed():
        before = robot.states[-1].cycles
        second.publish(message)
        deadline = time.monotonic() + 1.0
        while robot.mode() != "fault" and time.monotonic() < deadline:
            time.sleep(0.005)
        return robot.mode() == "fault" and (robot.states[-1].fault, robot.states[-1].cycles - before)

    fault, took = wait_until(said_and_noticed, 20, "a fault")
    print(f"a second publisher of joint states: {fault} after {took} cycles, of them up to {STATE_CYCLES} before its message")
    # Where the robot has moved on since the message that it repeats, its encoders jump first.
    assert fault and set(fault.split(",")) <= {"clock_jump", "encoder_jump"}, fault
    assert took <= STATE_CYCLES + SLACK_CYCLES
    robot.client.node.destroy_publisher(second)
    robot.client.node.destroy_subscription(subscription)
    robot.walk()


def test_the_bridge_killed_while_walking(robot):
    """No joint state any more: the controller damps by its own clock."""
    before = robot.states[-1]
    assert before.mode == "walking"
    robot.states.clear()
    kill(robot.bridge)
    safe = wait_until(robot.safe_states, 20, "damping")[0]
    # The last state before is up to STATE_CYCLES old.
    took = safe.cycles - before.cycles
    print(f"bridge killed: the controller damps after {took} cycles, of them up to {STATE_CYCLES} before it was killed")
    assert safe.fault == "stale_joint_state" and safe.mode == "damping", safe
    assert TIMEOUT_CYCLES / 2 < took <= TIMEOUT_CYCLES + STATE_CYCLES + SLACK_CYCLES
    assert robot.controller.alive()
    assert robot.controller.stop() == 0
