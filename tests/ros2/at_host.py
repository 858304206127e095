"""An rclpy node for test_hosts.py that runs on a host of its own: one JSON request a line on standard input, one answer a line.

{"call": NAME, "type": "package/srv/Type", "fields": {...}, "seconds": S}   calls a service, trying again until it answers
{"watch": NAME, "type": "package/msg/Type"}                                 begins to keep what a topic says
{"say": NAME, "type": "package/msg/Type", "fields": {...}}                 says it from now on, 20 times a second
{"received": NAME, "fields": [...]}                                            what it received since, with the time of each message
{"graph": NAMESPACE}                                                        the DDS topics there, with writers and readers of each
"""

import importlib
import json
import sys
import threading
import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy


def class_of(name):
    package, kind, type_ = name.split("/")
    return getattr(importlib.import_module(f"{package}.{kind}"), type_)


rclpy.init()
node = rclpy.create_node("at_host_" + sys.argv[1])
executor = SingleThreadedExecutor()
executor.add_node(node)
threading.Thread(target=executor.spin, daemon=True).start()
received, clients, published = {}, {}, {}


def call(name, type_, fields, seconds):
    if name not in clients:
        clients[name] = node.create_client(class_of(type_), name)
    client, began, tries = clients[name], time.monotonic(), 0
    while time.monotonic() - began < seconds:
        if not client.wait_for_service(0.2):
            continue
        time.sleep(0.1)
        future = client.call_async(class_of(type_).Request(**fields))
        tries += 1
        # A server that was killed is still in the graph for a while: what is sent to it is lost.
        until = time.monotonic() + 4.5
        while not future.done() and time.monotonic() < min(until, began + seconds):
            time.sleep(0.01)
        if future.done():
            response = future.result()
            answer = {key: getattr(response, key) for key in ("success", "status", "message", "gait") if hasattr(response, key)}
            return {**answer, "seconds": time.monotonic() - began, "tries": tries}
    return {"error": f"{name}: no answer within {seconds} s, {tries} tries"}


def value(message, path):
    for part in path.split("."):
        message = getattr(message, part)
    return message


for line in sys.stdin:
    request = json.loads(line)
    if "call" in request:
        answer = call(request["call"], request["type"], request.get("fields", {}), request.get("seconds", 30))
    elif "watch" in request:
        kept = received[request["watch"]] = []
        node.create_subscription(
            class_of(request["type"]), request["watch"], lambda m, kept=kept: kept.append((time.monotonic(), m)),
            QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT),
        )  # fmt: skip
        answer = {}
    elif "say" in request:
        name, type_ = request["say"], class_of(request["type"])
        if name not in published:
            publisher = node.create_publisher(type_, name, 10)
            published[name] = [publisher, None]
            node.create_timer(0.05, lambda published=published[name]: published[0].publish(published[1]))
        published[name][1] = type_(**request["fields"])
        answer = {}
    elif "graph" in request:
        names = [name for name, _ in node.get_topic_names_and_types(no_demangle=True) if name[2:].startswith(request["graph"] + "/")]
        answer = [[name, len(node.get_publishers_info_by_topic(name, True)), len(node.get_subscriptions_info_by_topic(name, True))] for name in names]
    else:
        answer = [[when, *(value(message, path) for path in request["fields"])] for when, message in list(received[request["received"]])]
    print(json.dumps(answer), flush=True)
