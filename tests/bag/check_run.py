"""A run's bag is whole for two independent programs: every message decodes with the schemas in the bag, counts match, times rise;
it is no longer than it may be, and no drive gave more than it can.

    python check_run.py TANDEM BAG...
"""

import json
import pathlib
import subprocess
import sys
import tempfile

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import Reader
from reading import check, embedded_types
from rosbags.typesys import Stores, get_typestore

# What a control cycle leaves: one message on each.
EVERY_CYCLE = ("/joint_command", "/control_cycle")
NEEDED = ("/joint_states", *EVERY_CYCLE, "/controller_state", "/gait_file", "/controller_config", "/robot_description")


# A minute at 1 kHz, compressed: what every robot has, and with what a simulation knows of the base and the ground. A
# machine that is busy writes smaller chunks, which compress less.
ESSENTIAL = ("/joint_states", "/joint_command", "/controller_state")
MOST_ESSENTIAL_BYTES, MOST_BYTES = 15e6, 17e6
DRIVE_TORQUE_NM = 87.5


def with_rosbags(folder):
    store = get_typestore(Stores.EMPTY)
    counts, last, cycles, largest_nm = {}, 0, [], 0.0
    with Reader(folder) as reader:
        for connection in reader.connections:
            types = embedded_types(connection.msgdef.data, connection.msgtype)
            store.register({name: value for name, value in types.items() if name not in store.types})
        for connection, stamp_ns, raw in reader.messages():
            check(stamp_ns >= last, f"{folder}: time falls at {stamp_ns}")
            last = stamp_ns
            message = store.deserialize_cdr(raw, connection.msgtype)
            if connection.topic == "/control_cycle":
                cycles.append(message.index)
            elif connection.topic == "/joint_states":
                largest_nm = max(largest_nm, max(map(abs, message.effort)))
            counts[connection.topic] = counts.get(connection.topic, 0) + 1
        declared = {connection.topic: connection.msgcount for connection in reader.connections if connection.msgcount}
        check(counts == declared, f"{folder}: rosbags found {counts}, metadata.yaml says {declared}")
    check(cycles == list(range(cycles[0], cycles[0] + len(cycles))), f"{folder}: a control cycle is missing")
    check(largest_nm <= DRIVE_TORQUE_NM, f"{folder}: a drive gave {largest_nm} N m, its limit is {DRIVE_TORQUE_NM}")
    return counts, largest_nm


def with_mcap(folder):
    counts = {}
    for file in sorted(folder.glob("*.mcap")):
        with open(file, "rb") as stream:
            for _, channel, _, _ in make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
                counts[channel.topic] = counts.get(channel.topic, 0) + 1
    return counts


def bytes_a_minute(info):
    return info["bytes"] / info["duration_s"] * 60


def essential(tandem, folder):
    """What the essential topics alone take, bytes a minute."""
    with tempfile.TemporaryDirectory() as parent:
        part = pathlib.Path(parent) / "part"
        topics = [word for topic in ESSENTIAL for word in ("--topic", topic)]
        subprocess.run([tandem, "bag", "filter", folder, "-o", part, *topics], check=True, capture_output=True)
        return bytes_a_minute(info_of(tandem, part))


def info_of(tandem, folder):
    return json.loads(subprocess.run([tandem, "bag", "info", "--json", folder], check=True, capture_output=True, text=True).stdout)


def main():
    tandem = sys.argv[1]
    for folder in map(pathlib.Path, sys.argv[2:]):
        counts, largest_nm = with_rosbags(folder)
        others = with_mcap(folder)
        check(counts == others, f"{folder}: rosbags found {counts}, mcap {others}")
        info = info_of(tandem, folder)
        ours = {topic["name"]: topic["messages"] for topic in info["topics"] if topic["messages"]}
        check(counts == ours, f"{folder}: rosbags found {counts}, we {ours}")
        for topic in NEEDED:
            check(topic in counts, f"{folder}: nothing on {topic}")
        check(len({counts[topic] for topic in EVERY_CYCLE}) == 1, f"{folder}: {counts}")
        check(info["missing_cycles"] == 0, f"{folder}: {info['missing_cycles']} cycles are missing")
        a_minute, least = bytes_a_minute(info), essential(tandem, folder)
        check(a_minute <= MOST_BYTES, f"{folder}: {a_minute * 1e-6:.1f} MB a minute")
        check(least <= MOST_ESSENTIAL_BYTES, f"{folder}: {', '.join(ESSENTIAL)} alone {least * 1e-6:.1f} MB a minute")
        print(f"{folder.name}: {sum(counts.values())} messages on {len(counts)} topics decode with the bag's own schemas, by rosbags and by mcap;"
              f" {a_minute * 1e-6:.1f} MB a minute ({least * 1e-6:.1f} of joints, commands and state), at most {largest_nm:.1f} N m")


main()
