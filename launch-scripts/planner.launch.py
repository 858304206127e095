"""The planner alone, on a computer off the robot: ros2 launch tandem planner.launch.py namespace:=robot1"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description():
    arguments = [
        DeclareLaunchArgument("namespace", default_value="", description="Namespace of the robot that it plans for."),
        DeclareLaunchArgument("robot", default_value="config/robots/vision60", description="Folder of the robot."),
    ]
    node = Node(
        package="tandem_planner",
        executable="tandem_planner",
        namespace=LaunchConfiguration("namespace"),
        parameters=[{"robot": LaunchConfiguration("robot")}],
    )
    return LaunchDescription([*arguments, node])
