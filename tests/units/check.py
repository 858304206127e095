"""check.py SYSTEMD_ANALYZE: holds each unit's exposure at the bound, and starts each program under its unit's system call filter."""

import ctypes
import ctypes.util
import errno
import os
import pathlib
import random
import re
import signal
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
TARGET = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release"
ANALYZE = sys.argv[1]
MOST_EXPOSURE = 2.0
# What each program reports when it is up. Over DDS: on CAN the filter is the same, only the sockets' family differs.
READY = {"tandem-controller": "disarmed, over DDS", "tandem-planner": "ready"}

SCMP_ACT_ALLOW, PR_SET_NO_NEW_PRIVS = 0x7FFF0000, 38


def exposure(unit):
    output = subprocess.run([ANALYZE, "security", "--offline=true", "--no-pager", unit], capture_output=True, text=True, check=True).stdout
    return float(re.search(r"Overall exposure level for \S+: ([0-9.]+)", output)[1])


def members(name, _cache={}):
    """The system calls of a set such as @system-service, sets in it included."""
    if not name.startswith("@"):
        return {name}
    if name not in _cache:
        output = subprocess.run([ANALYZE, "syscall-filter", "--no-pager", name], capture_output=True, text=True, check=True).stdout
        words = [line.strip() for line in output.splitlines()[1:] if line.strip() and not line.strip().startswith("#")]
        _cache[name] = set().union(*(members(word) for word in words))
    return _cache[name]


def allowed(unit):
    """As systemd reads it: the first line makes it a list of what is allowed; later ones add, or take away with ~."""
    calls = members("@default")
    for line in re.findall(r"^SystemCallFilter=(.+)$", unit.read_text(), re.MULTILINE):
        named = set().union(*(members(word) for word in line.lstrip("~").split()))
        calls = calls - named if line.startswith("~") else calls | named
    return calls


def confine(calls, libseccomp):
    """In the child, before the program: everything else fails with EPERM."""
    context = libseccomp.seccomp_init(ctypes.c_uint32(0x00050000 | errno.EPERM))
    for call in calls:
        number = libseccomp.seccomp_syscall_resolve_name(call.encode())
        # Of another architecture or a newer kernel than the library knows: stays forbidden.
        if number >= 0:
            assert libseccomp.seccomp_rule_add(ctypes.c_void_p(context), ctypes.c_uint32(SCMP_ACT_ALLOW), number, 0) == 0, call
    assert ctypes.CDLL(None).prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0
    assert libseccomp.seccomp_load(ctypes.c_void_p(context)) == 0


def runs(unit, libseccomp):
    """Starts the unit's program under its filter; what it printed if it did not come up or did not end in order."""
    program = TARGET / unit.stem.replace("-", "_")
    calls = allowed(unit)
    environment = {**os.environ, "ROS_DOMAIN_ID": str(random.randint(1, 100)), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    with tempfile.NamedTemporaryFile("w+") as log:
        # A call that every filter here forbids, to see that the filter is there.
        forbidden = subprocess.run(
            ["mount", "-t", "tmpfs", "none", "/mnt"], stdout=log, stderr=log, preexec_fn=lambda: confine(calls, libseccomp)
        )  # fmt: skip
        assert forbidden.returncode != 0, f"{unit.name}: mount is not kept from it"
        process = subprocess.Popen(
            [program, "--ros-args", "-p", "autostart:=true"], stdout=log, stderr=log, cwd=ROOT, env=environment,
            preexec_fn=lambda: confine(calls, libseccomp),
        )  # fmt: skip
        output = lambda: pathlib.Path(log.name).read_text(errors="replace")
        # Generous: nothing here is about time.
        deadline = time.monotonic() + 60
        while READY[unit.stem] not in output() and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.05)
        ready = READY[unit.stem] in output()
        process.send_signal(signal.SIGTERM)
        try:
            code = process.wait(60)
        except subprocess.TimeoutExpired:
            process.kill()
            code = process.wait()
        return None if ready and code == 0 else f"code {code}; it printed:\n{output()}"


def main():
    passed = failed = 0
    library = ctypes.util.find_library("seccomp")
    libseccomp = ctypes.CDLL(library) if library else None
    if libseccomp:
        libseccomp.seccomp_init.restype = ctypes.c_void_p
    for unit in sorted((ROOT / "config/systemd").glob("*.service")):
        found = exposure(unit)
        good = found <= MOST_EXPOSURE
        print(f"{unit.name}: exposure {found}, at most {MOST_EXPOSURE}: {'passed' if good else 'FAILED'}")
        passed, failed = passed + good, failed + (not good)
        if not libseccomp or unit.stem not in READY:
            print(f"{unit.name}: not started under its filter: {'no libseccomp here' if unit.stem in READY else 'not named in READY'}")
            failed += unit.stem not in READY
            continue
        problem = runs(unit, libseccomp)
        print(f"{unit.name}: starts and ends under its system call filter: {f'FAILED: {problem}' if problem else 'passed'}")
        passed, failed = passed + (not problem), failed + bool(problem)
    print(f"units: {passed} passed, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
