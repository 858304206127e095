"""The planner alone, on a computer off the robot: ros2 launch tandem planner.launch.py namespace:=robot1"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description():
    arguments = [
        DeclareLaunchArgument("namespace", default_value="", description="Namespace of the robot that it plans for."),
        DeclareLaunchArgument("robot", default_value="config/robots/vision60", description="Folder of the robot."),
        DeclareLaunchArgument(
            "autostart", default_value="true", choices=["true", "false"], description="false: wait for the lifecycle services."
        ),
        DeclareLaunchArgument(
            "use_sim_time", default_value="false", choices=["true", "false"], description="true: stamps by /clock, beside a simulation."
        ),
    ]
    node = Node(
        package="tandem_planner",
        executable="tandem_planner",
        namespace=LaunchConfiguration("namespace"),
        parameters=[
            {
                "robot": LaunchConfiguration("robot"),
                "autostart": ParameterValue(LaunchConfiguration("autostart"), value_type=bool),
                "use_sim_time": ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool),
            }
        ],
    )
    return LaunchDescription([*arguments, node])
