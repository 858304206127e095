"""Stand up, plan an amble, walk twenty steps of it, stop and sit down. Run it beside the three nodes."""

import rclpy
from rclpy.node import Node
from std_srvs.srv import Trigger
from tandem_msgs.msg import ControllerState
from tandem_msgs.srv import GenerateGait


class FirstWalk(Node):
    def __init__(self):
        super().__init__("first_walk")
        self.create_subscription(ControllerState, "controller_state", self.received, 10)
        self.state = ControllerState()

    def received(self, state):
        self.state = state

    def call(self, type_, name, **fields):
        client = self.create_client(type_, name)
        if not client.wait_for_service(20):
            raise SystemExit(f"{name}: nobody serves it; are the nodes running?")
        future = client.call_async(type_.Request(**fields))
        rclpy.spin_until_future_complete(self, future, timeout_sec=30)
        answer = future.result()
        if answer is None or not answer.success:
            raise SystemExit(f"{name}: {answer.message if answer else 'no answer'}")
        print(f"{name}: {answer.message or 'done'}")
        return answer

    def wait(self, reached):
        while not reached(self.state):
            if self.state.mode == "fault":
                raise SystemExit(f"fault: {self.state.fault}")
            rclpy.spin_once(self)


rclpy.init()
robot = FirstWalk()
robot.call(Trigger, "arm")
robot.call(Trigger, "stand")
gait = robot.call(GenerateGait, "generate_gait", behaviour="amble").gait
robot.wait(lambda state: state.mode == "standing" and state.gait == gait)
robot.call(Trigger, "walk")
robot.wait(lambda state: state.step_index >= 20)
robot.call(Trigger, "stop")
robot.wait(lambda state: state.mode == "standing")
robot.call(Trigger, "sit")
robot.wait(lambda state: state.mode == "disarmed")
rclpy.shutdown()
