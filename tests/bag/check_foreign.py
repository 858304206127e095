"""Bags made by rosbags' own writer (MCAP and sqlite3, with and without compression) are read by us, to the value.

    python check_foreign.py TANDEM FOLDER
"""

import csv
import json
import pathlib
import subprocess
import sys

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_KILTED)
TYPES = STORE.types
COUNT = 500


def joint_state(number):
    time = TYPES["builtin_interfaces/msg/Time"](sec=1 + number // 1000, nanosec=number % 1000 * 1_000_000)
    header = TYPES["std_msgs/msg/Header"](stamp=time, frame_id="base, \"link\"")
    values = number + np.arange(12) / 16
    return TYPES["sensor_msgs/msg/JointState"](
        header=header, name=[f"joint_{j}" for j in range(12)], position=values, velocity=-values, effort=values * 0.1)


def check(condition, what):
    if not condition:
        sys.exit(f"FAILED: {what}")


def main():
    tandem, folder = sys.argv[1], pathlib.Path(sys.argv[2])
    done = 0
    for storage in (StoragePlugin.MCAP, StoragePlugin.SQLITE3):
        for mode in (None, CompressionMode.MESSAGE):
            for version in (8, 9):
                if mode and storage == StoragePlugin.MCAP:
                    continue  # MCAP compresses inside the file
                name = f"{storage.name}_{mode.name if mode else 'plain'}_{version}".lower()
                bag = folder / name
                writer = Writer(bag, version=version, storage_plugin=storage)
                if mode:
                    writer.set_compression(mode, CompressionFormat.ZSTD)
                fill(writer)
                info = json.loads(subprocess.run([tandem, "bag", "info", "--json", bag], check=True, capture_output=True, text=True).stdout)
                check(info["storage"] == storage.name.lower(), f"{name}: storage {info['storage']}")
                counts = {topic["name"]: topic["messages"] for topic in info["topics"]}
                check(counts == {"/joint_states": COUNT, "/words": COUNT // 10}, f"{name}: counts {counts}")
                check(info["start_ns"] == 1_000_000_000 and info["end_ns"] == 1_000_000_000 + (COUNT - 1) * 1_000_000, f"{name}: times")
                out = folder / f"{name}_csv"
                subprocess.run([tandem, "bag", "export", bag, "-o", out], check=True, capture_output=True)
                with open(out / "joint_states.csv", newline="") as stream:
                    rows = list(csv.DictReader(stream))
                check(len(rows) == COUNT, f"{name}: {len(rows)} rows")
                for number, row in enumerate(rows):
                    expected = joint_state(number)
                    check(int(row["stamp_ns"]) == 1_000_000_000 + number * 1_000_000, f"{name}: stamp of row {number}")
                    check(row["header.frame_id"] == 'base, "link"', f"{name}: text of row {number}")
                    for joint in range(12):
                        for field in ("position", "velocity", "effort"):
                            check(float(row[f"{field}[{joint}]"]) == getattr(expected, field)[joint], f"{name}: {field} of row {number}")
                with open(out / "words.csv", newline="") as stream:
                    words = [row["data"] for row in csv.DictReader(stream)]
                check(words == [f"word {number}, größer" for number in range(0, COUNT, 10)], f"{name}: words")
                done += 1
    print(f"{done} bags of rosbags' writer read and exported, every value the same")


def fill(writer):
    with writer:
        states = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=STORE)
        words = writer.add_connection("/words", "std_msgs/msg/String", typestore=STORE)
        for number in range(COUNT):
            stamp = 1_000_000_000 + number * 1_000_000
            writer.write(states, stamp, STORE.serialize_cdr(joint_state(number), "sensor_msgs/msg/JointState"))
            if number % 10 == 0:
                text = TYPES["std_msgs/msg/String"](data=f"word {number}, größer")
                writer.write(words, stamp, STORE.serialize_cdr(text, "std_msgs/msg/String"))


main()
