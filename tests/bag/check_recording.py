"""Reads a bag written by `sample_bag` with two independent programs, rosbags and mcap, and checks every message.

    python check_recording.py FOLDER [CYCLES]
"""

import pathlib
import sys

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import Reader
from reading import check, embedded_types
from rosbags.typesys import Stores, get_typestore

FIRST_NS = 1_000_000_000
CYCLE_NS = 1_000_000


def stamp_of(header):
    return header.stamp.sec * 1_000_000_000 + header.stamp.nanosec


def check_values(topic, message, stamp_ns, cycle):
    def same(array, scale):
        expected = scale * (cycle * 0.001 + np.arange(12))
        return np.array_equal(np.asarray(array), expected)

    if topic == "/joint_states":
        check(stamp_of(message.header) == stamp_ns, f"{topic} header stamp at cycle {cycle}")
        check(list(message.name) == [f"joint_{j}" for j in range(12)], f"{topic} names at cycle {cycle}")
        good = same(message.position, 1.0) and same(message.velocity, 2.0) and same(message.effort, 3.0)
        check(good, f"{topic} values at cycle {cycle}")
    elif topic == "/joint_command":
        scales = dict(position=4.0, velocity=5.0, kp=6.0, kd=7.0, torque=8.0)
        for field, scale in scales.items():
            check(same(getattr(message, field), scale), f"{topic} {field} at cycle {cycle}")
    elif topic == "/clock":
        check(message.clock.sec * 1_000_000_000 + message.clock.nanosec == stamp_ns, f"{topic} at cycle {cycle}")
    elif topic == "/robot_description":
        check(message.data == '<robot name="größe"/>', "/robot_description text")
    else:
        sys.exit(f"FAILED: a message on {topic}, where none was recorded")


def check_counts(counts, cycles, reader):
    expected = {"/joint_states": cycles, "/joint_command": cycles, "/clock": cycles, "/robot_description": 1}
    found = {topic: count for topic, count in counts.items() if count}
    check(found == expected, f"{reader}: counts {found}, expected {expected}")


def with_rosbags(folder, cycles):
    store = get_typestore(Stores.EMPTY)
    standard = get_typestore(Stores.ROS2_KILTED)
    with Reader(folder) as reader:
        compared = 0
        for connection in reader.connections:
            types = embedded_types(connection.msgdef.data, connection.msgtype)
            store.register({name: value for name, value in types.items() if name not in store.types})
            check(connection.digest == store.hash_rihs01(connection.msgtype), f"type hash of {connection.topic} in metadata.yaml: {connection.digest!r}")
            if connection.msgtype in standard.types:
                ours, theirs = store.hash_rihs01(connection.msgtype), standard.hash_rihs01(connection.msgtype)
                check(ours == theirs, f"definition of {connection.msgtype} is not ROS 2's")
                compared += 1
        check(compared >= 34, f"only {compared} standard definitions compared")
        qos = {c.topic: c.ext.offered_qos_profiles[0] for c in reader.connections}
        check(qos["/joint_states"].reliability.name == "BEST_EFFORT", "QoS of /joint_states")
        check(qos["/robot_description"].durability.name == "TRANSIENT_LOCAL", "QoS of /robot_description")
        counts, last = {}, 0
        for connection, stamp_ns, raw in reader.messages():
            check(stamp_ns >= last, f"rosbags: time falls at {stamp_ns}")
            last = stamp_ns
            message = store.deserialize_cdr(raw, connection.msgtype)
            cycle = (stamp_ns - FIRST_NS) // CYCLE_NS
            check_values(connection.topic, message, stamp_ns, cycle)
            counts[connection.topic] = counts.get(connection.topic, 0) + 1
        check_counts(counts, cycles, "rosbags")
        check(reader.message_count == 3 * cycles + 1, f"metadata.yaml counts {reader.message_count}")
        check(reader.start_time == FIRST_NS, "start time")
        check(reader.end_time == FIRST_NS + (cycles - 1) * CYCLE_NS + 1, "end time")
        hashes = {connection.topic: connection.digest for connection in reader.connections}
    return sum(counts.values()), hashes


def with_mcap(folder, cycles, hashes):
    counts = {}
    files = sorted(folder.glob("*.mcap"), key=lambda path: int(path.stem.rsplit("_", 1)[1]))
    for file in files:
        with open(file, "rb") as stream:
            reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
            check(reader.get_header().profile == "ros2", "profile")
            last = 0
            for _, channel, record, message in reader.iter_decoded_messages():
                check(record.log_time >= last, f"mcap: time falls at {record.log_time}")
                last = record.log_time
                cycle = (record.log_time - FIRST_NS) // CYCLE_NS
                check_values(channel.topic, message, record.log_time, cycle)
                counts[channel.topic] = counts.get(channel.topic, 0) + 1
            for channel in reader.get_summary().channels.values():
                check(channel.metadata["topic_type_hash"] == hashes[channel.topic], f"type hash of {channel.topic} in the file")
            statistics = reader.get_summary().statistics
            check(statistics.message_count == sum(statistics.channel_message_counts.values()), "statistics")
    check_counts(counts, cycles, "mcap")
    return len(files)


def main():
    folder = pathlib.Path(sys.argv[1])
    cycles = int(sys.argv[2]) if len(sys.argv) > 2 else 2000
    messages, hashes = with_rosbags(folder, cycles)
    files = with_mcap(folder, cycles, hashes)
    print(f"{folder}: {messages} messages in {files} file(s), the same by rosbags and by mcap")


main()
