"""What recording costs beside a walking controller: processor time of its two threads, memory, bytes. By hand; figures stand in docs/benchmarks.md.

    python3 tests/bag/measure.py [SECONDS]        after launch-scripts/demo has built the programs

Starts the three nodes in realtime in a domain of its own and lets `tandem walk` walk and record the amble. Processor times are the
kernel's for the threads "recording" (cycles to messages) and "bag writer" (messages to the disk), so that other programs on the machine
matter little.
"""

import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAMS = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release"
TICKS = os.sysconf("SC_CLK_TCK")
THREADS = ("recording", "bag writer")


def processor_s(process):
    """Processor time of the recording's threads, s, by name."""
    used = dict.fromkeys(THREADS, 0.0)
    for task in pathlib.Path(f"/proc/{process}/task").iterdir():
        try:
            text = (task / "stat").read_text()
        except OSError:
            continue  # it has just ended
        name, rest = text[text.index("(") + 1 : text.rindex(")")], text[text.rindex(")") + 2 :].split()
        if name in used:
            used[name] += (int(rest[11]) + int(rest[12])) / TICKS
    return used


def resident_mb(process):
    for line in pathlib.Path(f"/proc/{process}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) * 1024e-6
    return 0.0


def main():
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    environment = dict(os.environ, ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    environment.setdefault("ROS_DOMAIN_ID", "84")
    with tempfile.TemporaryDirectory() as folder:
        def start(name, *arguments):
            log = open(f"{folder}/{name}.log", "wb")
            return subprocess.Popen([PROGRAMS / name, *arguments], cwd=ROOT, env=environment, stdout=log, stderr=log)

        nodes = [start("tandem_planner"), start("tandem_controller"),
                 start("tandem_sim_bridge", "--ros-args", "-p", "odometry_rate_hz:=200.0")]
        controller = nodes[1].pid
        try:
            time.sleep(3)
            before, most, last, recorded = resident_mb(controller), 0.0, {}, None
            walk = subprocess.Popen([PROGRAMS / "tandem", "walk", "amble", "--seconds", str(seconds), "--out", folder],
                                    cwd=ROOT, env=environment, stdout=subprocess.DEVNULL)
            while walk.poll() is None:
                time.sleep(0.2)
                most = max(most, resident_mb(controller))
                used = processor_s(controller)
                # The bag writer's thread ends with the recording.
                if used["bag writer"]:
                    recorded = recorded or (time.monotonic(), used)
                    last = (time.monotonic(), used)
            if walk.returncode or not recorded:
                sys.exit(f"the walk ended with code {walk.returncode}; {pathlib.Path(folder, 'tandem_controller.log').read_text()[-2000:]}")
            bag = f"{folder}/amble/bag"
            info = json.loads(subprocess.run([PROGRAMS / "tandem", "bag", "info", "--json", bag], check=True, capture_output=True).stdout)
        finally:
            for node in nodes:
                node.send_signal(2)
            for node in nodes:
                node.wait(20)
    took = last[0] - recorded[0]
    for name in THREADS:
        print(f"{name.replace(' ', '_')}_percent = {100 * (last[1][name] - recorded[1][name]) / took:.2f}")
    print(f"processor_percent = {100 * sum(last[1][name] - recorded[1][name] for name in THREADS) / took:.2f}   (at most 5)")
    print(f"memory_added_mb = {most - before:.1f}   (at most 30; from before the first gait to the most while walking)")
    print(f"mb_a_minute = {info['bytes'] / info['duration_s'] * 60e-6:.2f}   (at most 15)")
    print(f"longest_hole_s = {info['longest_hole_s']:.3f}, missing_cycles = {info['missing_cycles']}, recorded_s = {info['duration_s']:.1f}")


main()
