"""check.py PROGRAMS PEER: nodes built with the feature `security` against Fast DDS (PEER, of peer.cpp), with keystores of sros2's form.

Both ways: discovery, topics, services, encrypted as sros2's governance says. Peers without credentials, with another authority's and expired credentials are
kept out, and who may not arm does not.
"""

import contextlib
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import traceback

import keystore

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAMS, PEER = pathlib.Path(sys.argv[1]), sys.argv[2]
DOMAIN = 102 + os.getpid() % 100
TRIGGER, SET_BOOL, JOINTS = "std_srvs/srv/Trigger", "std_srvs/srv/SetBool", "sensor_msgs/msg/JointState"
# How long a request, an answer or a first sample may take, with discovery and authentication before it.
PATIENCE_S = 30
# How long somebody who is kept out tries; who is let in is there in 2 s.
KEPT_OUT_S = 8
# Shorter than the 20 s for which a peer on Fast DDS that is not received is kept (docs/security.md).
OUTAGE_S = float(os.environ.get("TANDEM_OUTAGE_S", "10"))
HEADER = bytes([0, 1, 0, 0])


def text(value):
    """As CDR has it: its length with the final zero."""
    return (len(value) + 1).to_bytes(4, "little") + value.encode() + b"\0"


def pad(body):
    return body + bytes(-len(body) % 4)


def joint_state(name):
    """A JointState with one joint and no values."""
    body = (5).to_bytes(4, "little") + (6).to_bytes(4, "little") + pad(text("base")) + (1).to_bytes(4, "little")
    return HEADER + pad(body + text(name)) + bytes(12)


def answer(reply):
    """success and message of std_srvs' responses."""
    length = int.from_bytes(reply[8:12], "little")
    return bool(reply[4]), reply[12 : 12 + length - 1].decode()


class Process:
    def __init__(self, command, environment=()):
        plain = {name: value for name, value in os.environ.items() if not name.startswith("ROS_")}
        self.process = subprocess.Popen(
            [str(part) for part in command], env=plain | dict(environment), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, bufsize=1)
        self.lines = []
        self.reader = threading.Thread(target=lambda: self.lines.extend(self.process.stdout), daemon=True)
        self.reader.start()

    def printed(self, what):
        return [line.strip() for line in list(self.lines) if what in line]

    def wait_for(self, what, timeout_s=PATIENCE_S):
        end = time.monotonic() + timeout_s
        while not self.printed(what):
            assert time.monotonic() < end, f"no '{what}' in {timeout_s} s: {''.join(self.lines)}"
            assert self.process.poll() is None or self.reader.is_alive(), f"ended without '{what}': {''.join(self.lines)}"
            time.sleep(0.02)
        return self.printed(what)[0]

    def end(self):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            try:
                self.process.wait(10)
            except subprocess.TimeoutExpired:
                self.process.kill()
        self.process.wait()
        self.reader.join(5)


class Bench:
    """Keystores and what runs."""

    def __init__(self, folder):
        self.ours = keystore.make(folder / "ours", DOMAIN, {"/tandem": [], "/remote": [], "/spectator": ["/arm"], "/keyless": []})
        self.theirs = keystore.make(folder / "theirs", DOMAIN, {"/tandem": [], "/remote": []})
        self.expired = keystore.make(folder / "expired", DOMAIN, {"/tandem": []}, days=-1)
        (self.ours / "enclaves/keyless/key.pem").unlink()
        # Who breaks in does not ask their own middleware for permission. Fast DDS takes [^a] for "no a" and lets the
        # peer have its way; RustDDS takes it for "^ or a" and applies the rule.
        permissions = self.ours / "enclaves/spectator/permissions.xml"
        permissions.write_text(permissions.read_text().replace("/armRe", "/[^a]rmRe"))
        keystore.sign((self.ours / "public/ca.cert.pem", self.ours / "private/ca.key.pem"), permissions, permissions.with_suffix(".p7s"))
        self.processes = []

    def run(self, command, environment=()):
        self.processes.append(Process(command, environment))
        return self.processes[-1]

    def node(self, program, *arguments, enclave="/tandem", store=None, **variables):
        security = {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_KEYSTORE": str(store or self.ours), "ROS_DOMAIN_ID": str(DOMAIN),
                    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        return self.run([PROGRAMS / program, "--ros-args", "--enclave", enclave, *arguments], security | variables)

    def peer(self, enclave, *arguments, seconds=PATIENCE_S):
        folder = "-" if enclave is None else (enclave if isinstance(enclave, pathlib.Path) else self.ours / "enclaves" / enclave)
        return self.run([PEER, DOMAIN, folder, seconds, *(part.hex() if isinstance(part, bytes) else part for part in arguments)])

    def call(self, enclave, service, kind, request, **options):
        """The answer, or None where nobody answered."""
        peer = self.peer(enclave, "call", service, kind, HEADER + request, **options)
        peer.process.wait(PATIENCE_S + 15)
        peer.reader.join(5)
        replies = peer.printed("reply ")
        assert replies or peer.printed("unmatched") or peer.printed("matched"), f"the peer says: {''.join(peer.lines)}"
        return answer(bytes.fromhex(replies[0].split()[1])) if replies else None

    def end(self):
        for process in self.processes:
            process.end()
        self.processes.clear()


def exercise(bench):
    node = bench.node("examples/exercise", "--log-level", "exercise:=debug")
    node.wait_for("ready")
    return node


@contextlib.contextmanager
def captured(found):
    """Everything on the loopback is put into `found`. Without the right to look that is printed, and `found` stays None."""
    try:
        tap = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(3))
    except PermissionError:
        print("tests/security: nobody may look at the loopback here: that nothing is readable is not checked")
        yield
        return
    tap.bind(("lo", 0))
    tap.settimeout(0.2)
    found.append(b"")
    over = threading.Event()

    def listen():
        while not over.is_set():
            with contextlib.suppress(TimeoutError):
                found[0] += tap.recv(65536)

    thread = threading.Thread(target=listen)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        tap.close()


def test_a_topic_goes_both_ways_and_nobody_else_can_read_it(bench):
    exercise(bench)
    sent = joint_state("shoulder_of_the_robot")
    received = []
    with captured(received):
        listener = bench.peer("remote", "listen", "/fast_output", JOINTS)
        bench.peer("remote", "talk", "/fast_input", JOINTS, sent)
        listener.wait_for("sample " + sent.hex())
        time.sleep(1)
    if received:
        assert len(received[0]) > 10_000, "nothing was captured, not even what is encrypted"
        assert b"shoulder_of_the_robot" not in received[0]


def test_a_service_of_ours_answers_a_payload_that_is_no_multiple_of_four(bench):
    exercise(bench)
    assert bench.call("remote", "/count", SET_BOOL, b"\x01") == (True, "1")
    assert bench.call("remote", "/count", SET_BOOL, b"\x01") == (True, "2")


def test_who_joins_takes_no_message_from_the_others(bench):
    node = exercise(bench)
    for count in range(1, 4):
        bench.peer("remote", "listen", "/description", "std_msgs/msg/String")
        assert bench.call("remote", "/count", SET_BOOL, b"\x01") == (True, str(count))
    # A message that cannot be encrypted for one reader, with whom keys are still being exchanged, went to none.
    assert not node.printed("Failed to send message to readers"), node.printed("Failed to send message to readers")


def test_after_a_short_outage_all_is_there_again(bench):
    node = exercise(bench)
    bench.peer("remote", "talk", "/fast_input", JOINTS, joint_state("friend"), seconds=240)
    listener = bench.peer("remote", "listen", "/fast_output", JOINTS, seconds=240)
    listener.wait_for("sample")
    subprocess.run(["ip", "link", "set", "lo", "down"], check=True)
    try:
        time.sleep(OUTAGE_S)
    finally:
        subprocess.run(["ip", "link", "set", "lo", "up", "multicast", "on"], check=True)
        subprocess.run(["ip", "route", "replace", "239.255.0.0/16", "dev", "lo"], check=True)
    before = len(listener.printed("sample"))
    began = time.monotonic()
    while len(listener.printed("sample")) < before + 3:
        assert time.monotonic() < began + PATIENCE_S, f"nothing {PATIENCE_S} s after an outage of {OUTAGE_S} s: {''.join(node.lines)}"
        time.sleep(0.05)
    print(f"tests/security: after an outage of {OUTAGE_S} s samples after {time.monotonic() - began:.1f} s")


def test_a_service_of_theirs_answers_us(bench):
    exercise(bench)
    server = bench.peer("remote", "serve", "/remote", SET_BOOL, HEADER + b"\x01\0\0\0" + text("as you say"), seconds=60)
    assert bench.call("remote", "/relay", TRIGGER, b"\0") == (True, "as you say")
    assert len(server.printed("request")) == 1


def kept_out(bench, enclave):
    node = exercise(bench)
    listener = bench.peer(enclave, "listen", "/fast_output", JOINTS, seconds=KEPT_OUT_S + 4)
    intruder = bench.peer(enclave, "talk", "/fast_input", JOINTS, joint_state("intruder"), seconds=KEPT_OUT_S + 4)
    witness = bench.peer("remote", "listen", "/fast_output", JOINTS, seconds=60)
    assert bench.call(enclave, "/count", SET_BOOL, b"\x01", seconds=KEPT_OUT_S) is None
    assert not node.printed("call 1"), "an intruder's request was taken"
    # Whoever belongs here is served meanwhile.
    assert bench.call("remote", "/count", SET_BOOL, b"\x01") == (True, "1")
    talker = bench.peer("remote", "talk", "/fast_input", JOINTS, joint_state("friend"), seconds=60)
    witness.wait_for("sample " + joint_state("friend").hex())
    talker.end()
    for peer in (listener, intruder):
        peer.process.wait(PATIENCE_S)
        peer.reader.join(5)
    assert not listener.printed("sample") and listener.printed("unmatched"), listener.lines
    assert intruder.printed("unmatched"), intruder.lines
    assert not witness.printed(joint_state("intruder").hex()), "an intruder's message went through"


def test_who_has_no_credentials_is_kept_out(bench):
    kept_out(bench, None)


def test_another_authoritys_are_kept_out(bench):
    kept_out(bench, bench.theirs / "enclaves/remote")


def test_who_may_not_arm_does_not(bench):
    bench.node("tandem_sim_bridge", "-p", "command_timeout_s:=1.0").wait_for("DDS Security")
    controller = bench.node("tandem_controller", "-p", "state_timeout_s:=1.0", "-p", "overrun_s:=1.0", "-p", "middleware_timeout_s:=1.0")
    controller.wait_for("disarmed")
    refused = bench.call("spectator", "/arm", TRIGGER, b"\0", seconds=KEPT_OUT_S)
    assert refused is None, refused
    # It is the permission that is missing: all else of the same peer is answered.
    success, message = bench.call("spectator", "/stand", TRIGGER, b"\0")
    assert not success and "arm" in message, message
    deadline = time.monotonic() + PATIENCE_S
    while True:
        success, message = bench.call("remote", "/arm", TRIGGER, b"\0")
        if success or time.monotonic() > deadline:
            break
    assert success, message
    assert bench.call("spectator", "/disarm", TRIGGER, b"\0")[0]


def refusal(bench, program="examples/exercise", **options):
    node = bench.node(program, **options)
    node.process.wait(PATIENCE_S)
    node.reader.join(5)
    assert node.process.returncode == 1, node.lines
    return "".join(node.lines)


def test_what_is_missing_is_named(bench):
    assert "enclaves/keyless/key.pem cannot be read" in refusal(bench, enclave="/keyless")
    assert "enclaves/nobody" in refusal(bench, enclave="/nobody")
    assert "/nowhere" in refusal(bench, store="/nowhere", ROS_SECURITY_STRATEGY="Enforce")
    for program in ("tandem_controller", "tandem_sim_bridge"):
        assert "enclaves/keyless/key.pem cannot be read" in refusal(bench, program, enclave="/tandem", ROS_SECURITY_ENCLAVE_OVERRIDE="/keyless")


def test_expired_credentials_are_refused(bench):
    assert "validity" in refusal(bench, store=bench.expired)


def test_permissive_runs_unprotected_and_says_so(bench):
    node = bench.node("examples/exercise", enclave="/keyless", ROS_SECURITY_STRATEGY="Permissive")
    node.wait_for("anybody on the network can command this node")
    node.wait_for("ready")
    assert bench.call(None, "/count", SET_BOOL, b"\x01") == (True, "1")


def main():
    passed, failed = 0, 0
    chosen = sys.argv[3] if len(sys.argv) > 3 else ""
    folder = pathlib.Path(tempfile.mkdtemp(prefix="tandem-security-"))
    try:
        bench = Bench(folder)
        for name, test in [item for item in globals().items() if item[0].startswith("test_") and chosen in item[0]]:
            began = time.monotonic()
            try:
                test(bench)
                passed += 1
                print(f"tests/security: {name}: passed, {time.monotonic() - began:.0f} s", flush=True)
            except (AssertionError, OSError, subprocess.SubprocessError):
                failed += 1
                print(f"tests/security: {name}: FAILED\n{traceback.format_exc()}", flush=True)
                for process in bench.processes:
                    print(f"--- {process.process.args}\n{''.join(process.lines)[-3000:]}", flush=True)
            finally:
                bench.end()
    finally:
        shutil.rmtree(folder)
    print(f"tests/security: {passed} passed, {failed} failed")
    sys.exit(failed != 0)


main()
