"""The controller on the robot's CAN buses. It comes up disarmed; arming is a service call of its own.

ros2 launch tandem hardware.launch.py bus_file:=config/hardware/vision60_can.toml core:=3

It demands a heartbeat on emergency_stop and counts as stopped without one. In a terminal of the person who watches the robot:

tandem stop-button                                             keys: space presses, r releases, q leaves (and stops the robot)
tandem stop-button --joystick /dev/input/js0 --button 0        a joystick's button beside the keys
tandem stop-button --ros-args -r __ns:=/NAMESPACE              where the controller has a namespace
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description():
    arguments = [
        DeclareLaunchArgument("namespace", default_value="", description="Namespace of the nodes."),
        DeclareLaunchArgument("robot", default_value="config/robots/vision60", description="Folder of the robot."),
        DeclareLaunchArgument(
            "autostart", default_value="true", choices=["true", "false"], description="false: wait for the lifecycle services."
        ),
        DeclareLaunchArgument("bus_file", default_value="config/hardware/vision60_can.toml", description="Joints to drives."),
        DeclareLaunchArgument("core", default_value="-1", description="Processor of the control thread; -1: any."),
        DeclareLaunchArgument(
            "emergency_stop_heartbeat_s",
            default_value="0.5",
            description="Longest silence of `tandem stop-button`, which must run; 0: silence means nothing.",
        ),
        DeclareLaunchArgument(
            "use_sim_time", default_value="false", choices=["true", "false"], description="true: stamps by /clock, beside a replayed bag."
        ),
        DeclareLaunchArgument(
            "planner", default_value="true", choices=["true", "false"], description="false: a planner runs elsewhere."
        ),
    ]
    value = LaunchConfiguration
    namespace = value("namespace")
    robot = {"robot": value("robot"), "autostart": ParameterValue(value("autostart"), value_type=bool)}
    time = {"use_sim_time": ParameterValue(value("use_sim_time"), value_type=bool)}
    hardware = {
        "backend": "can",
        "bus_file": value("bus_file"),
        "core": ParameterValue(value("core"), value_type=int),
        "emergency_stop_heartbeat_s": ParameterValue(value("emergency_stop_heartbeat_s"), value_type=float),
    }
    nodes = [
        Node(package="tandem_controller", executable="tandem_controller", namespace=namespace, parameters=[robot, hardware, time]),
        Node(
            package="tandem_planner",
            executable="tandem_planner",
            namespace=namespace,
            parameters=[robot, time],
            condition=IfCondition(value("planner")),
        ),
    ]
    return LaunchDescription(arguments + nodes)
