"""Planner, controller and MuJoCo in one place: ros2 launch tandem simulation.launch.py [mode:=lockstep] [terrain:=rough] ..."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description():
    arguments = [
        DeclareLaunchArgument("namespace", default_value="", description="Namespace of the three nodes."),
        DeclareLaunchArgument("robot", default_value="config/robots/vision60", description="Folder of the robot."),
        DeclareLaunchArgument(
            "autostart", default_value="true", choices=["true", "false"], description="false: wait for the lifecycle services."
        ),
        DeclareLaunchArgument(
            "mode", default_value="realtime", choices=["realtime", "lockstep"], description="Wall clock, or step by step."
        ),
        DeclareLaunchArgument(
            "terrain", default_value="flat", choices=["flat", "slope", "rough", "steps"], description="The ground."
        ),
        DeclareLaunchArgument(
            "use_sim_time", default_value="true", choices=["true", "false"], description="Stamps by /clock, which the simulation publishes."
        ),
        DeclareLaunchArgument(
            "balance", default_value="false", choices=["true", "false"],
            description="Walk in balance and obey cmd_vel; the controller publishes odom, the simulation ground_truth/odom.",
        ),
        DeclareLaunchArgument(
            "cmd_vel_walks", default_value="false", choices=["true", "false"],
            description="With balance: a cmd_vel begins the walk of a robot that stands.",
        ),
        DeclareLaunchArgument("initial_posture", default_value="sit", choices=["sit", "stand"], description="At the start."),
    ]
    value = LaunchConfiguration
    namespace = value("namespace")
    robot = {"robot": value("robot"), "autostart": ParameterValue(value("autostart"), value_type=bool)}
    mode = {"mode": value("mode")}
    # The simulation makes /clock and stamps by itself.
    time = {"use_sim_time": ParameterValue(value("use_sim_time"), value_type=bool)}
    balance = ParameterValue(value("balance"), value_type=bool)
    driven = {"balance": balance, "cmd_vel_walks": ParameterValue(value("cmd_vel_walks"), value_type=bool)}
    scene = {"terrain": value("terrain"), "initial_posture": value("initial_posture")}
    nodes = [
        Node(package="tandem_planner", executable="tandem_planner", namespace=namespace, parameters=[robot, time]),
        Node(package="tandem_controller", executable="tandem_controller", namespace=namespace, parameters=[robot, mode, time, driven]),
        Node(
            package="tandem_sim_bridge", executable="tandem_sim_bridge", namespace=namespace, parameters=[robot, mode, scene, {"ground_truth": balance}]
        ),
    ]
    return LaunchDescription(arguments + nodes)
