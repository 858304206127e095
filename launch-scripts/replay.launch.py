"""Plays a bag to whoever listens: ros2 launch tandem replay.launch.py bag:=/path/to/bag rate:=0.5"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.substitutions import FindPackagePrefix


def generate_launch_description():
    arguments = [
        DeclareLaunchArgument("bag", description="The bag: its folder or its file."),
        DeclareLaunchArgument("rate", default_value="1.0", description="Played seconds per second, 0.1 to 10."),
    ]
    program = PathJoinSubstitution([FindPackagePrefix("tandem_cli"), "lib", "tandem_cli", "tandem"])
    play = ExecuteProcess(
        cmd=[program, "bag", "play", LaunchConfiguration("bag"), "--rate", LaunchConfiguration("rate")], output="screen"
    )
    return LaunchDescription([*arguments, play])
