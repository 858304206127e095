"""launched.py FILE NAME:=VALUE...: what `ros2 launch FILE NAME:=VALUE...` runs, with ROS 2's own launch system and without its command
line. Ends when all that it started has ended, or at SIGINT."""

import sys
import types

# launch_ros imports it for containers of components, which these files do not use; it is in no wheel.
composition = types.ModuleType("composition_interfaces")
composition.srv = types.ModuleType("composition_interfaces.srv")
composition.srv.LoadNode = type("LoadNode", (), {"Request": type("Request", (), {}), "Response": type("Response", (), {})})
sys.modules.update({"composition_interfaces": composition, "composition_interfaces.srv": composition.srv})

from launch import LaunchDescription, LaunchService  # noqa: E402
from launch.actions import IncludeLaunchDescription  # noqa: E402
from launch.launch_description_sources import PythonLaunchDescriptionSource  # noqa: E402

file, *arguments = sys.argv[1:]
service = LaunchService()
included = IncludeLaunchDescription(
    PythonLaunchDescriptionSource(file), launch_arguments=[tuple(argument.split(":=", 1)) for argument in arguments]
)
service.include_launch_description(LaunchDescription([included]))
sys.exit(service.run())
