"""RTPS messages as bytes, what a wire carries, and who listens on it: for the tests that send what no participant sends."""

import os
import pathlib
import socket
import struct
import time

RUSTDDS, FAST_DDS = b"\x01\x12", b"\x01\x0f"
SPDP_WRITER, SPDP_READER = bytes.fromhex("000100c2"), bytes.fromhex("000100c7")
SEDP = [(bytes.fromhex("000003c2"), bytes.fromhex("000003c7")), (bytes.fromhex("000004c2"), bytes.fromhex("000004c7"))]
DATA, ACKNACK, HEARTBEAT, GAP, NACK_FRAG, DATA_FRAG, INFO_DST = 0x15, 0x06, 0x07, 0x08, 0x12, 0x16, 0x0E


def message(prefix, *submessages):
    return b"RTPS\x02\x04" + RUSTDDS + prefix + b"".join(submessages)


def submessage(kind, flags, body):
    return struct.pack("<BBH", kind, flags, len(body)) + body


def number(value):
    """A sequence number: high word, low word."""
    value &= (1 << 64) - 1
    return struct.pack("<II", value >> 32, value & 0xFFFFFFFF)


def to(prefix):
    return submessage(INFO_DST, 1, prefix)


def heartbeat(reader, writer, first, last, count):
    return submessage(HEARTBEAT, 1, reader + writer + number(first) + number(last) + struct.pack("<I", count & 0x7FFFFFFF))


def gap(reader, writer, start, base):
    return submessage(GAP, 1, reader + writer + number(start) + number(base) + struct.pack("<I", 0))


def data_frag(reader, writer, sample, first, count, fragment_bytes, sample_bytes, payload):
    head = struct.pack("<HH", 0, 28) + reader + writer + number(sample) + struct.pack("<IHHI", first, count, fragment_bytes, sample_bytes)
    return submessage(DATA_FRAG, 1, head + payload)


def acknack(reader, writer, base, bits, count):
    return submessage(ACKNACK, 1, reader + writer + number(base) + struct.pack("<II", 32, bits) + struct.pack("<I", count & 0x7FFFFFFF))


def nack_frag(reader, writer, sample, base, count):
    numbers = struct.pack("<III", base, 32, 0xFFFFFFFF)
    return submessage(NACK_FRAG, 1, reader + writer + number(sample) + numbers + struct.pack("<I", count & 0x7FFFFFFF))


def disposal(reader, writer, sample, key, guid):
    """DATA that says that what `guid` names is gone; `key` is the parameter that carries the name."""
    head = struct.pack("<HH", 0, 16) + reader + writer + number(sample)
    inline = struct.pack("<HH", 0x71, 4) + b"\0\0\0\3" + struct.pack("<HH", 1, 0)
    named = b"\0\3\0\0" + struct.pack("<HH", key, 16) + guid + struct.pack("<HH", 1, 0)
    return submessage(DATA, 0x0B, head + inline + named)


def farewell(prefix):
    guid = prefix + bytes.fromhex("000001c1")
    return message(prefix, disposal(SPDP_READER, SPDP_WRITER, 1 << 20, 0x50, guid))


def announcement(prefix, address, port):
    """A participant's announcement of itself, reached at one address."""
    parameter = lambda key, value: struct.pack("<HH", key, len(value)) + value
    locator = struct.pack("<II", 1, port) + bytes(12) + bytes(map(int, address.split(".")))
    parameters = [
        parameter(0x15, b"\2\4\0\0"), parameter(0x16, RUSTDDS + b"\0\0"), parameter(0x50, prefix + bytes.fromhex("000001c1")),
        parameter(0x32, locator), parameter(0x31, locator), parameter(0x02, struct.pack("<II", 20, 0)), parameter(0x58, struct.pack("<I", 0x3F)),
        struct.pack("<HH", 1, 0),
    ]  # fmt: skip
    head = struct.pack("<HH", 0, 16) + SPDP_READER + SPDP_WRITER + number(1)
    return message(prefix, submessage(DATA, 0x05, head + b"\0\3\0\0" + b"".join(parameters)))


def submessages(datagram):
    """(kind, flags, where its body begins, where it ends) of each."""
    at = 20
    while at + 4 <= len(datagram):
        kind, flags, length = datagram[at], datagram[at + 1], struct.unpack("<H" if datagram[at + 1] & 1 else ">H", datagram[at + 2 : at + 4])[0]
        end = len(datagram) if length == 0 and kind not in (0x01, 0x09) else min(at + 4 + length, len(datagram))
        yield kind, flags, at + 4, end
        at = end


def listens(pids):
    """UDP ports of each process: {pid: [port, ...]}."""
    ports = {}
    for line in pathlib.Path("/proc/net/udp").read_text().splitlines()[1:]:
        fields = line.split()
        ports[fields[9]] = int(fields[1].split(":")[1], 16)
    found = {}
    for pid in pids:
        for descriptor in os.listdir(f"/proc/{pid}/fd"):
            try:
                target = os.readlink(f"/proc/{pid}/fd/{descriptor}")
            except FileNotFoundError:
                continue  # closed meanwhile
            if target.startswith("socket:[") and target[8:-1] in ports:
                found.setdefault(pid, []).append(ports[target[8:-1]])
    return found


def capture(seconds, ports, most=3000):
    """RTPS datagrams on the loopback to the given UDP ports, with the port they come from."""
    wire = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(0x0003))
    wire.bind(("lo", 0))
    wire.settimeout(0.2)
    seen, kinds, until = [], {}, time.monotonic() + seconds
    while time.monotonic() < until:
        try:
            frame = wire.recv(65536)
        except TimeoutError:
            continue
        if len(frame) < 62 or frame[12:14] != b"\x08\x00" or frame[23] != 17:
            continue
        at = 14 + 4 * (frame[14] & 15)
        source, port = struct.unpack(">HH", frame[at : at + 4])
        payload = frame[at + 8 :]
        if payload[:4] != b"RTPS" or port not in ports:
            continue
        # A few of each sort: joint states come a thousand times a second.
        sort = (payload[8:20], port, tuple((kind, payload[begin : begin + 12]) for kind, _, begin, _ in submessages(payload)))
        kinds[sort] = kinds.get(sort, 0) + 1
        if kinds[sort] <= 4 and len(seen) < most:
            seen.append((source, port, payload))
    wire.close()
    return seen


class Known:
    """What a listener learns of participants: their writers with the newest number of each, and their readers."""

    def __init__(self, datagrams, vendor=None):
        self.writers, self.readers, self.prefixes = {}, {}, []
        for _, _, datagram in datagrams:
            prefix = datagram[8:20]
            if vendor and datagram[6:8] != vendor:
                continue
            if prefix not in self.prefixes:
                self.prefixes.append(prefix)
            for kind, flags, begin, end in submessages(datagram):
                body, order = datagram[begin:end], "<" if flags & 1 else ">"
                if kind == DATA and len(body) >= 20:
                    self._written(prefix, body[8:12], body[12:20], order)
                elif kind == HEARTBEAT and len(body) >= 28:
                    self._written(prefix, body[4:8], body[16:24], order)
                elif kind == ACKNACK and len(body) >= 8:
                    self.readers.setdefault(prefix, set()).add((body[0:4], body[4:8]))

    def _written(self, prefix, writer, sample, order):
        high, low = struct.unpack(order + "iI", sample)
        written = self.writers.setdefault(prefix, {})
        written[writer] = max(written.get(writer, 0), (high << 32) + low)
