"""Every Rust message against rclpy's own: names and types of all fields, and random values there and back. No network."""

import importlib
import json
import pathlib
import random
import re
import struct
import subprocess
import sys

import pytest
from conftest import ROOT, TARGET

MESSAGES = TARGET / "examples/messages"
SEED = 20  # the same values in every run


def rust_fields():
    if not MESSAGES.exists():
        pytest.exit(f"{MESSAGES} is missing: build it first (launch-scripts/test does)", 1)
    lines = subprocess.run([MESSAGES, "fields"], check=True, capture_output=True, text=True).stdout.splitlines()
    table = {}
    for line in lines:
        name, *fields = line.split(" ")
        table[name] = [tuple(field.split("=", 1)) for field in fields if field]
    return table


FIELDS = rust_fields()


def python_type(name):
    """The class of `package/msg/Name` or `package/srv/Name.Request`."""
    package, kind, name = name.split("/")
    value = importlib.import_module(f"{package}.{kind}")
    for part in name.split("."):
        value = getattr(value, part)
    return value


def as_definition(type_name):
    """rclpy's way to write a type, as a definition file writes it."""
    if type_name.startswith("sequence<"):
        inner, _, bound = type_name[len("sequence<") : -1].partition(", ")
        return f"{as_definition(inner)}[<={bound}]" if bound else f"{as_definition(inner)}[]"
    names = {"double": "float64", "float": "float32", "boolean": "bool", "octet": "byte"}
    base, bracket, rest = type_name.partition("[")
    return names.get(base, base) + bracket + rest


def test_no_message_is_forgotten():
    defined = {
        match for file in (ROOT / "msgs/src").glob("*.rs") if "messages!" in file.read_text() and file.name != "macros.rs"
        for match in re.findall(r"^ +([A-Z]\w+) \{$", file.read_text().split("messages! {", 1)[1], re.MULTILINE)
    }  # fmt: skip
    listed = {name.split("/")[2].replace(".", "") for name in FIELDS}
    listed |= {name.replace("Goal", "Request") for name in listed}
    # tf2_msgs has no wheel: its one message is read by Cyclone DDS in test_two_robots.py.
    assert defined - listed == {"TFMessage"}


@pytest.mark.parametrize("name", FIELDS)
def test_fields_are_those_of_the_definition(name):
    expected = [
        (field, as_definition(type_name)) for field, type_name in python_type(name).get_fields_and_field_types().items()
    ]
    # Without members of its own a structure carries one byte, of which rclpy does not speak.
    ours = [pair for pair in FIELDS[name] if pair[0] != "structure_needs_at_least_one_member"]
    assert ours == expected


def test_hashes_are_those_of_rosidl():
    """Of every type, what ROS 2's own generator wrote for it (REP 2016)."""
    lines = subprocess.run([MESSAGES, "hashes"], check=True, capture_output=True, text=True).stdout.splitlines()
    ours = dict(line.split() for line in lines)
    ros = {}
    for file in pathlib.Path(sys.prefix, "share").glob("*/*/*.json"):
        ros |= {entry["type_name"]: entry["hash_string"] for entry in json.loads(file.read_text()).get("type_hashes", [])}
    assert len(ours) > len(FIELDS)
    assert {name: ros.get(name) for name in ours} == ours


def random_text(source):
    letters = "abcdefghijklmnopqrstuvwxyz_/ 0123456789äöü✓"
    return "".join(source.choice(letters) for _ in range(source.choice([0, 1, 3, 4, 17, 40])))


INTEGERS = {"byte": 8, "octet": 8}


def random_value(type_name, source):
    if type_name.startswith("sequence<"):
        inner, _, bound = type_name[len("sequence<") : -1].partition(", ")
        length = source.randint(0, int(bound)) if bound else source.choice([0, 1, 2, 5])
        values = [random_value(inner, source) for _ in range(length)]
        return values
    if type_name.endswith("]"):
        inner, _, length = type_name[:-1].partition("[")
        return [random_value(inner, source) for _ in range(int(length))]
    if type_name == "boolean":
        return source.random() < 0.5
    if type_name == "string":
        return random_text(source)
    if type_name in ("double", "float64"):
        return source.choice([0.0, -0.0, 1e-300, -1e300, source.uniform(-10, 10), float("inf")])
    if type_name in ("float", "float32"):
        return struct.unpack("f", struct.pack("f", source.uniform(-10, 10)))[0]
    if type_name == "octet":
        return bytes([source.randrange(256)])
    if "/" in type_name:
        package, name = type_name.split("/")
        return random_message(python_type(f"{package}/msg/{name}"), source)
    unsigned = type_name.startswith("uint")
    bits = int(type_name.removeprefix("u").removeprefix("int"))
    low, high = (0, 2**bits - 1) if unsigned else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    return source.choice([low, high, 0, source.randint(low, high)])


def random_message(type_, source):
    message = type_()
    for field, type_name in type_.get_fields_and_field_types().items():
        setattr(message, field, random_value(type_name, source))
    return message


def test_random_values_go_there_and_back():
    from rclpy.serialization import deserialize_message, serialize_message

    source = random.Random(SEED)
    process = subprocess.Popen([MESSAGES], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    count = 0
    for name in FIELDS:
        type_ = python_type(name)
        for _ in range(40):
            message = random_message(type_, source)
            cdr = serialize_message(message)
            process.stdin.write(f"{name} {len(cdr)}\n".encode() + cdr)
            process.stdin.flush()
            length = process.stdout.readline()
            assert length, f"{name}: not decoded: {message}"
            back = deserialize_message(process.stdout.read(int(length)), type_)
            assert back == message, name
            count += 1
    process.stdin.close()
    assert process.wait(10) == 0
    assert count == 40 * len(FIELDS)
