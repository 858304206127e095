"""Sends mutated and forged RTPS to processes of this machine, seeded: what was captured of their own traffic, changed, and messages made up
in their names and in those of participants that do not exist.

    flood.py DOMAIN SECONDS PACKETS_PER_SECOND SEED PID...

The contents of user topics are left out: whoever can forge a joint state moves the robot, and only DDS Security is against that. Their
DATA goes out with an encoding that nobody knows. Prints what was sent, as one line of JSON, at the end.
"""

import json
import random
import socket
import struct
import sys
import time

import rtps

ANYBODY = b"\0\0\0\0"
NUMBERS = [-(1 << 63), -1, 0, 1, 2, 3, 100, 1 << 16, 1 << 31, 1 << 32, 1 << 40, 1 << 62, (1 << 62) + 1, (1 << 63) - 2, (1 << 63) - 1]


class Generator:
    def __init__(self, datagrams, seed):
        self.random = random.Random(seed)
        self.datagrams = [datagram for _, _, datagram in datagrams]
        self.announcements = [d for d in self.datagrams if rtps.SPDP_WRITER in d[20:60] or any(w in d[20:80] for w, _ in rtps.SEDP)]
        self.known = rtps.Known(datagrams, rtps.RUSTDDS)
        assert self.known.prefixes, "no participant of these processes was received"
        self.kinds = [
            (40, self.mutated), (10, self.heartbeat), (10, self.gap), (8, self.fragment), (6, self.acknowledgment), (6, self.missing_fragment),
            (3, self.farewell), (4, self.endpoint_disposal), (6, self.unknown_participant), (3, self.garbage), (2, self.submessages_at_random),
        ]  # fmt: skip
        self.sent = {}

    def next(self):
        (kind,) = self.random.choices([kind for _, kind in self.kinds], [weight for weight, _ in self.kinds])
        self.sent[kind.__name__] = self.sent.get(kind.__name__, 0) + 1
        return kind()

    def prefix(self):
        return self.random.choice(self.known.prefixes)

    def number(self, near=0):
        choose = self.random.random()
        if choose < 0.5:
            return self.random.choice(NUMBERS)
        return near + self.random.randint(-300, 300) if choose < 0.9 else self.random.getrandbits(64)

    def writer(self):
        prefix = self.prefix()
        writers = self.known.writers.get(prefix) or {rtps.SEDP[0][0]: 1}
        writer = self.random.choice(sorted(writers))
        return prefix, writer, writers[writer]

    def mutated(self):
        bytes_ = bytearray(self.random.choice(self.datagrams))
        keep = [range(20)] if self.random.random() < 0.9 else []
        for kind, flags, begin, end in list(rtps.submessages(bytes_)):
            user = end - begin >= 24 and bytes_[begin + 11] & 0xC0 == 0
            if kind in (rtps.DATA, rtps.DATA_FRAG) and user:
                length = struct.unpack_from("<H" if flags & 1 else ">H", bytes_, begin + 2)[0]
                payload = begin + 4 + length
                if payload + 4 <= end:
                    bytes_[payload : payload + 2] = b"\xff\xff"
                    keep.append(range(payload, payload + 2))
                    keep.append(range(begin - 4, begin + 20))
                    bytes_[begin + 12 : begin + 20] = rtps.number(self.number(1000)) if kind == rtps.DATA and self.random.random() < 0.3 else bytes_[begin + 12 : begin + 20]
        for _ in range(self.random.choice((1, 1, 2, 4, 16))):
            at = self.random.randrange(len(bytes_))
            if not any(at in span for span in keep):
                bytes_[at] = self.random.choice((0, 0xFF, 0x7F, 0x80, bytes_[at] ^ (1 << self.random.randrange(8)), self.random.randrange(256)))
        if self.random.random() < 0.1:
            del bytes_[self.random.randrange(20, len(bytes_)) :]
        return bytes(bytes_)

    def heartbeat(self):
        prefix, writer, last = self.writer()
        count = self.random.choice((1, 1 << 30, 0x7FFFFFFF, self.random.getrandbits(31)))
        return rtps.message(prefix, rtps.heartbeat(ANYBODY, writer, self.number(last), self.number(last), count))

    def gap(self):
        prefix, writer, last = self.writer()
        return rtps.message(prefix, rtps.gap(ANYBODY, writer, self.number(last), self.number(last)))

    def fragment(self):
        prefix, writer, last = self.writer()
        first, count = self.random.choice((0, 1, 2, 60000, 1 << 31, 0xFFFFFFFF)), self.random.choice((0, 1, 2, 0xFFFF))
        size, sample = self.random.choice((0, 1, 256, 1400, 0xFFFF)), self.random.choice((0, 3, 4000, 1 << 20, 1 << 24, 1 << 31, 0xFFFFFFFF))
        payload = b"\xff\xff\0\0" + self.random.randbytes(self.random.randrange(1200))
        return rtps.message(prefix, rtps.data_frag(ANYBODY, writer, self.number(last), first, count, size, sample, payload))

    def reader(self):
        prefix = self.prefix()
        pairs = sorted(self.known.readers.get(prefix) or [(rtps.SEDP[0][1], rtps.SEDP[0][0])])
        return (prefix, *self.random.choice(pairs))

    def acknowledgment(self):
        prefix, reader, writer = self.reader()
        return rtps.message(prefix, rtps.acknack(reader, writer, self.number(5), self.random.getrandbits(32), self.random.getrandbits(31)))

    def missing_fragment(self):
        prefix, reader, writer = self.reader()
        base = self.random.choice((0, 1, 2, 1000, 1 << 16, 1 << 31, 0xFFFFFFFF))
        return rtps.message(prefix, rtps.nack_frag(reader, writer, self.number(5), base, self.random.getrandbits(31)))

    def farewell(self):
        return rtps.farewell(self.prefix())

    def endpoint_disposal(self):
        prefix, writer, last = self.writer()
        sedp_writer, sedp_reader = self.random.choice(rtps.SEDP)
        newest = self.known.writers.get(prefix, {}).get(sedp_writer, 1)
        return rtps.message(prefix, rtps.disposal(sedp_reader, sedp_writer, newest + self.random.randint(1, 50), 0x5A, prefix + writer))

    def unknown_participant(self):
        """Announcements of participants and endpoints that do not exist."""
        if not self.announcements:
            return self.garbage()
        other, datagram = b"\x01\x12" + self.random.randbytes(10), self.random.choice(self.announcements)
        return datagram.replace(datagram[8:20], other)

    def garbage(self):
        return rtps.message(self.prefix(), self.random.randbytes(self.random.randrange(200)))

    def submessages_at_random(self):
        many = [rtps.submessage(self.random.randrange(256), self.random.randrange(256), self.random.randbytes(self.random.randrange(60))) for _ in range(20)]
        return rtps.message(self.prefix(), *many)


def main():
    domain, seconds, rate, seed = int(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3]), int(sys.argv[4])
    pids = [int(pid) for pid in sys.argv[5:]]
    first = 7400 + 250 * domain
    unicast = sorted({port for ports in rtps.listens(pids).values() for port in ports if first + 10 <= port < first + 250})
    received = rtps.capture(4, {first, first + 1, *unicast})
    generator = Generator(received, seed)
    targets = [("127.0.0.1", port) for port in unicast] * 2 + [("239.255.0.1", first), ("239.255.0.1", first + 1)]
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
    print(json.dumps({"captured": len(received), "participants": len(generator.known.prefixes), "ports": unicast}), flush=True)
    began, count = time.monotonic(), 0
    while (now := time.monotonic()) < began + seconds:
        while count < (now - began) * rate:
            out.sendto(generator.next(), generator.random.choice(targets))
            count += 1
        time.sleep(0.002)
    print(json.dumps({"packets": count, "seconds": time.monotonic() - began, "kinds": generator.sent}), flush=True)


if __name__ == "__main__":
    main()
