"""One datagram each, sent in the name of a participant that the node knows. Nothing may come of it: no memory, no thread lost, no panic,
and the node answers as before."""

import os
import pathlib
import socket
import threading
import time

import pytest
import rtps
from conftest import DOMAIN, Client, wait_until

GROWTH_BYTES = 20 << 20
FIRST_PORT = 7400 + 250 * DOMAIN


def resident_bytes(pid):
    return int(pathlib.Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def threads(pid):
    return len(os.listdir(f"/proc/{pid}/task"))


class Pair:
    """The node that is attacked, and another one in whose name that is done."""

    def __init__(self, processes):
        self.node = processes("tandem_planner", "--ros-args", "-r", "__ns:=/attacked", name="attacked")
        self.other = processes("tandem_planner", "--ros-args", "-r", "__ns:=/spoofed", name="spoofed")
        self.client = Client("asker")
        self.generate = self.service("/attacked/generate_gait")
        self.of_other = self.service("/spoofed/generate_gait")
        self.out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.ports = self.metatraffic(self.node)
        # Who says what: what goes to a node's own port is from others, what comes from a node's socket is its own.
        received = rtps.capture(7, {FIRST_PORT, *self.ports})
        mine = {port for ports in rtps.listens([self.other.process.pid]).values() for port in ports}
        prefixes = {datagram[8:20] for source, _, datagram in received if source in mine and datagram[6:8] == rtps.RUSTDDS}
        assert len(prefixes) == 1, "the other participant is received"
        (self.spoofed,) = prefixes
        mine = {port for ports in rtps.listens([os.getpid()]).values() for port in ports}
        self.asker = next(datagram[8:20] for source, _, datagram in received if source in mine and datagram[6:8] == rtps.FAST_DDS)

    def service(self, name):
        from tandem_msgs.srv import GenerateGait

        return self.client.service(GenerateGait, name)

    def metatraffic(self, node):
        return [p for p in rtps.listens([node.process.pid])[node.process.pid] if FIRST_PORT + 10 <= p < FIRST_PORT + 250]

    def send(self, *submessages, raw=None):
        for port in self.ports:
            self.out.sendto(raw or rtps.message(self.spoofed, *submessages), ("127.0.0.1", port))

    def answers(self, client, seconds=1.0):
        from tandem_msgs.srv import GenerateGait

        began = time.monotonic()
        assert not self.client.call(client, GenerateGait.Request(behaviour="moonwalk"), seconds).success
        return time.monotonic() - began


@pytest.fixture(scope="module")
def pair(processes, ros):
    pair = Pair(processes)
    yield pair
    pair.client.close()


WRITER, READER = rtps.SEDP[0]
DATAGRAMS = {
    "a_heartbeat_of_a_range_without_end": [rtps.heartbeat(READER, WRITER, 1, 1 << 62, 1 << 20)],
    "a_heartbeat_at_the_end_of_the_numbers": [rtps.heartbeat(READER, WRITER, (1 << 63) - 8, (1 << 63) - 1, 1 << 21)],
    "a_gap_without_end": [rtps.gap(READER, WRITER, 100, 1 << 62)],
    "a_fragment_of_four_gigabytes": [rtps.data_frag(READER, WRITER, 1000, 1, 1, 1400, 0xFFFFFFFF, b"\0" * 1400)],
    "a_request_for_fragment_zero": [rtps.nack_frag(READER, WRITER, 1, 0, 1)],
    "a_request_for_a_fragment_far_away": [rtps.nack_frag(READER, WRITER, 1, 0xFFFFFF00, 2)],
    "an_acknowledgment_of_what_was_never_sent": [rtps.acknack(READER, WRITER, 1 << 62, 0xFFFFFFFF, 1 << 20)],
}


@pytest.mark.parametrize("name", DATAGRAMS)
def test_nothing_comes_of(pair, name):
    pid = pair.node.process.pid
    memory, tasks = resident_bytes(pid), threads(pid)
    for port in pair.ports:
        pair.send(*DATAGRAMS[name])
    time.sleep(1.0)
    assert pair.node.alive(), pair.node.text()[-3000:]
    grown = resident_bytes(pid) - memory
    assert grown < GROWTH_BYTES and threads(pid) >= tasks and "panicked" not in pair.node.text(), (grown, pair.node.text()[-3000:])
    print(f"{name}: {grown / 2**20:.1f} MB more, answered in {1000 * pair.answers(pair.generate):.0f} ms")


def test_a_farewell_that_others_send_is_not_believed(pair):
    """The other node is still there: whoever it sends to has to go on receiving it. The node that is attacked asks it, and it answers."""
    before = pair.node.text()
    for _ in range(3):
        pair.send(raw=rtps.farewell(pair.spoofed))
        time.sleep(1.5)
        assert pair.answers(pair.generate) < 1 and pair.answers(pair.of_other) < 1
    # Both nodes go on exchanging announcements: the attacked one asks the other's writers every two seconds.
    other = pair.metatraffic(pair.other)
    mine = set(rtps.listens([pair.node.process.pid])[pair.node.process.pid])
    to_other = lambda: [d for source, _, d in rtps.capture(5, set(other)) if source in mine and any(k == rtps.ACKNACK for k, *_ in rtps.submessages(d))]
    assert to_other(), "the attacked node still knows the other one"
    assert "panicked" not in pair.node.text()[len(before) :]


def test_a_forged_heartbeat_does_not_stop_reception(pair):
    """Forged in the name of the test's own participant: an endpoint that this announces afterwards is received, or no answer would reach it."""
    for writer, reader in rtps.SEDP:
        pair.send(raw=rtps.message(pair.asker, rtps.heartbeat(reader, writer, 1 << 40, 1 << 41, 1 << 22)))
        pair.send(raw=rtps.message(pair.asker, rtps.gap(reader, writer, 1, 1 << 40)))
    time.sleep(5)
    newcomer = pair.service("/attacked/generate_gait")
    print(f"a client that came after it is answered in {1000 * pair.answers(newcomer, 5.0):.0f} ms")


def test_an_endpoint_that_others_dispose_of_stays(pair):
    """Its participant still announces it: that is asked, three times within a second, before the end of an endpoint is believed."""
    received = []
    listening = threading.Thread(target=lambda: received.extend(rtps.capture(5, {FIRST_PORT, *pair.ports})))
    listening.start()
    while listening.is_alive():
        pair.answers(pair.generate)
        time.sleep(0.2)
    known = rtps.Known(received, rtps.FAST_DDS)
    written = known.writers[pair.asker]
    of_users = lambda entities: sorted({entity for entity in entities if entity[3] & 0xC0 == 0})
    endpoints = [of_users(written), of_users(reader for reader, _ in known.readers[pair.asker])]
    assert all(endpoints), f"the asker's writers and readers are received: {known.writers} {known.readers}"
    for (writer, reader), entities in zip(rtps.SEDP, endpoints, strict=True):
        for number, entity in enumerate(entities, written[writer] + 1):
            pair.send(raw=rtps.message(pair.asker, rtps.disposal(reader, writer, number, 0x5A, pair.asker + entity)))
    slowest, began = 0.0, time.monotonic()
    while time.monotonic() < began + 4:
        slowest = max(slowest, pair.answers(pair.generate))
        time.sleep(0.05)
    print(f"answered in at most {1000 * slowest:.0f} ms after {sum(map(len, endpoints))} endpoints were reported gone")


def test_a_publisher_that_goes_on_sending_has_not_ended_whatever_others_send(processes, ros):
    """Its end is sent over and over, and that its announcements no longer exist, so that asking for them does not help."""
    from sensor_msgs.msg import JointState
    from tandem_msgs.msg import ControllerState
    from test_walk import JOINTS

    controller = processes("tandem_controller", "--ros-args", "-r", "__ns:=/listener", "-p", "mode:=lockstep", name="listener")
    client, states = Client("talker"), []
    publisher = client.node.create_publisher(JointState, "/listener/joint_states", 10)
    client.node.create_subscription(ControllerState, "/listener/controller_state", states.append, 100)
    wait_until(lambda: publisher.get_subscription_count(), 20, "the controller listens")
    ports = [port for port in rtps.listens([controller.process.pid])[controller.process.pid] if FIRST_PORT + 10 <= port < FIRST_PORT + 250]
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def talk(seconds, *, attack=None):
        """States at 500 Hz; how many of them the controller took."""
        before, sent, began = states[-1].cycles if states else 0, 0, time.monotonic()
        while (now := time.monotonic()) < began + seconds:
            while sent < 500 * (now - began):
                talk.stamp_ms += 1
                message = JointState(name=JOINTS, position=[0.0] * 12, velocity=[0.0] * 12, effort=[0.0] * 12)
                message.header.stamp.sec, message.header.stamp.nanosec = divmod(talk.stamp_ms * 1_000_000, 1_000_000_000)
                publisher.publish(message)
                sent += 1
                if attack and sent % 10 == 0:
                    for port in ports:
                        out.sendto(attack(sent), ("127.0.0.1", port))
            time.sleep(0.002)
        return sent, states[-1].cycles - before

    talk.stamp_ms = 1000
    captured = []
    listening = threading.Thread(target=lambda: captured.extend(rtps.capture(6, set(ports))))
    listening.start()
    talk(6.5)
    listening.join()
    mine = {port for ports in rtps.listens([os.getpid()]).values() for port in ports}
    known = rtps.Known([datagram for datagram in captured if datagram[0] in mine], rtps.FAST_DDS)
    (asker,) = known.prefixes
    # The joint states are what it writes most of.
    entity = max((entity for entity in known.writers[asker] if entity[3] & 0xC0 == 0), key=known.writers[asker].get)

    def end(count):
        number = 1000 + count  # no gap before it, or it would wait for what is missing
        return rtps.message(asker, rtps.gap(READER, WRITER, 1, number), rtps.disposal(READER, WRITER, number, 0x5A, asker + entity))

    sent, taken = talk(6, attack=end)
    print(f"{taken} of {sent} states were taken while their publisher was reported gone")
    assert taken >= 0.98 * sent, "they are received all the while"
    client.close()
