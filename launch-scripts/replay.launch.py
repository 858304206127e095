"""Plays a bag to whoever listens: ros2 launch tandem replay.launch.py bag:=/path/to/bag rate:=0.5"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.conditions import IfCondition, UnlessCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.substitutions import FindPackagePrefix


def generate_launch_description():
    arguments = [
        DeclareLaunchArgument("bag", description="The bag: its folder or its file."),
        DeclareLaunchArgument(
            "clock", default_value="true", choices=["true", "false"], description="Publish /clock, for nodes with use_sim_time."
        ),
        DeclareLaunchArgument("rate", default_value="1.0", description="Played seconds per second, 0.1 to 10."),
    ]
    program = PathJoinSubstitution([FindPackagePrefix("tandem_cli"), "lib", "tandem_cli", "tandem"])
    command = [program, "bag", "play", LaunchConfiguration("bag"), "--rate", LaunchConfiguration("rate")]
    clock = LaunchConfiguration("clock")
    play = ExecuteProcess(cmd=[*command, "--clock"], output="screen", condition=IfCondition(clock))
    play_without_clock = ExecuteProcess(cmd=command, output="screen", condition=UnlessCondition(clock))
    return LaunchDescription([*arguments, play, play_without_clock])
