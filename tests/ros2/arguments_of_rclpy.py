"""What rclpy makes of command lines: reads a list of them as JSON, writes names and parameters, or the error, of each."""

import json
import sys

import rclpy
from rclpy.context import Context

DEFAULTS = {
    "rate": 1.0,
    "count": 1,
    "flag": False,
    "text": "text",
    "group.deep.list": [0.5],
    "numbers": [1],
    "words": ["a"],
    "flags": [True],
}


def plain(value):
    return list(value) if isinstance(value, (list, tuple)) or type(value).__name__ == "array" else value


def parsed(arguments):
    context = Context()
    try:
        rclpy.init(args=["program", *arguments], context=context)
        rest = rclpy.utilities.remove_ros_args(["program", *arguments])[1:]
        node = rclpy.create_node("walker", context=context)
        name = f"{node.get_namespace().rstrip('/')}/{node.get_name()}"
        topics = {topic: node.resolve_topic_name(topic) for topic in ["chatter", "/chatter", "~/state", "a/b"]}
        services = {service: node.resolve_service_name(service) for service in ["add", "~/get", "chatter"]}
        parameters = {key: plain(node.declare_parameter(key, default).value) for key, default in DEFAULTS.items()}
        node.destroy_node()
        return {"name": name, "topics": topics, "services": services, "parameters": parameters, "rest": rest}
    except Exception as error:
        return {"error": f"{type(error).__name__}: {error}"}
    finally:
        context.try_shutdown()


print(json.dumps([parsed(arguments) for arguments in json.load(sys.stdin)]))
