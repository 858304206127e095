"""How many pictures a second the page of `tandem show --web` draws in headless Chromium, of a robot that walks: on the wall clock, or out of
a bag that was recorded in lockstep. Not a test: it wants a machine of its own.

    .tools/rclpy-kilted/bin/python tests/ros2/measure_page.py live|bag [RUNS] [WIDTHxHEIGHT]
"""

import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import time

from at_browser import Browser
from conftest import ROOT, TARGET, Process, wait_until

SECONDS = 10
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
COUNT = """new Promise((done) => {
  const begin = performance.now(), times = [begin];
  const tick = (now) => { times.push(now); performance.now() - begin > %d ? done(times) : requestAnimationFrame(tick); };
  requestAnimationFrame(tick); })"""
# A program of its own, gone when the robot walks: its subscriptions would be part of what is measured.
WALK = """
import rclpy, time
from std_srvs.srv import Trigger
from tandem_msgs.msg import ControllerState
from tandem_msgs.srv import GenerateGait
rclpy.init()
node = rclpy.create_node("operator")
states = []
node.create_subscription(ControllerState, "controller_state", states.append, 10)
def call(type_, name, request, seconds=60):
    client = node.create_client(type_, name)
    assert client.wait_for_service(seconds)
    while True:
        future = client.call_async(request)
        rclpy.spin_until_future_complete(node, future, timeout_sec=seconds)
        if future.result().success: return
        time.sleep(0.5)
def wait(mode):
    while not states or states[-1].mode != mode: rclpy.spin_once(node)
call(Trigger, "arm", Trigger.Request())
call(Trigger, "stand", Trigger.Request())
call(GenerateGait, "generate_gait", GenerateGait.Request(behaviour="amble"))
wait("standing")
call(Trigger, "walk", Trigger.Request())
wait("walking")
"""


def start_live(folder):
    nodes = [
        Process(TARGET / "tandem_planner", [], folder / "planner.log"),
        Process(TARGET / "tandem_controller", ["--ros-args", "-p", "use_sim_time:=true"], folder / "controller.log"),
        Process(TARGET / "tandem_sim_bridge", [], folder / "sim_bridge.log"),
    ]
    subprocess.run([sys.executable, "-c", WALK], check=True, timeout=120)
    return nodes


def start_bag(folder):
    tandem = TARGET / "tandem"
    quiet = {"check": True, "cwd": ROOT, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    subprocess.run([tandem, "plan", "amble", "-o", folder / "amble.json"], **quiet)
    subprocess.run([tandem, "simulate", folder / "amble.json", "--seconds", "60", "--bag", folder / "walk"], **quiet)
    return [Process(tandem, ["bag", "play", folder / "walk"], folder / "play.log")]


def processor_s():
    """Processor time of every process that this one has begun, directly or not, by name: others use the machine too."""
    used, parents, tick = {}, {}, os.sysconf("SC_CLK_TCK")
    for stat in pathlib.Path("/proc").glob("[0-9]*/stat"):
        try:
            text, line = stat.read_text(), (stat.parent / "cmdline").read_text()
        except OSError:
            continue
        name, fields = text[text.index("(") + 1 : text.rindex(")")], text[text.rindex(")") + 2 :].split()
        kind = re.search(r"--type=([\w-]+)", line)
        parents[int(stat.parent.name)] = (int(fields[1]), f"{name} {kind[1] if kind else ''}".strip(), (int(fields[11]) + int(fields[12])) / tick)
    for process, (parent, name, seconds) in parents.items():
        while parent not in (os.getpid(), 0):
            parent = parents.get(parent, (0,))[0]
        if parent:
            used[name] = used.get(name, 0) + seconds
    return used


def page_s(browser):
    """Processor time of the page's main thread: its script, and all of its tasks (layout, and recording what is to be painted, too)."""
    values = {metric["name"]: metric["value"] for metric in browser.call("Performance.getMetrics")["metrics"]}
    return values["ScriptDuration"], values["TaskDuration"]


def shown(browser):
    """Pictures a second that Chromium laid on the screen, by its own trace. A page may draw more than are shown: those of an OffscreenCanvas
    that come late give way to the next one."""
    page, browser.session = browser.session, None
    browser.call("Tracing.start", traceConfig={"includedCategories": ["viz"]}, transferMode="ReportEvents")
    time.sleep(SECONDS)
    browser.call("Tracing.end")

    def complete():
        browser.call("Target.getTargets")
        return any(event["method"] == "Tracing.tracingComplete" for event in browser.events)

    wait_until(complete, 60, "Chromium's trace")
    browser.session = page
    parts = [event["params"]["value"] for event in browser.events if event["method"] == "Tracing.dataCollected"]
    times = sorted(entry["ts"] for part in parts for entry in part if entry["name"] == "DirectRenderer::DrawFrame" and entry["ph"] in "XB")
    return (len(times) - 1) / (times[-1] - times[0]) * 1e6


def main():
    what, runs = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 3
    size = sys.argv[3] if len(sys.argv) > 3 else "1280x800"
    folder = pathlib.Path(tempfile.mkdtemp())
    started = {"live": start_live, "bag": start_bag}[what](folder)
    view = Process(TARGET / "tandem", ["show", "--web=0"], folder / "show.log")
    port = wait_until(lambda: re.search(r"http://127\.0\.0\.1:(\d+) ", view.text()), 20, view.text)[1]
    try:
        with Browser(CHROMIUM, folder / "profile", f"http://127.0.0.1:{port}/", size.replace("x", ",")) as browser:
            browser.wait("document.body?.dataset.ready === 'yes' && frames.length > 10", 20)
            # Processor time and not the clock's: a busy machine changes the pictures a second, and not what one costs.
            browser.call("Performance.enable", timeDomain="threadTicks")
            time.sleep(2)
            for run in range(runs):
                before, page = processor_s(), page_s(browser)
                times = browser.run(COUNT % (SECONDS * 1000))
                script_ms, tasks_ms = [1000 * (b - a) / (len(times) - 1) for a, b in zip(page, page_s(browser))]
                used = {name: s - before.get(name, 0) for name, s in processor_s().items()}
                gaps = [b - a for a, b in zip(times, times[1:])]
                shares = sorted(((s / (times[-1] - times[0]) * 1000, name) for name, s in used.items() if s > 0.02 * SECONDS), reverse=True)
                mode = browser.run("newest.state && newest.state.mode")
                print(f"{what} {run + 1}: {len(gaps) / (times[-1] - times[0]) * 1000:.1f} pictures a second, longest gap {max(gaps):.0f} ms, {mode}; "
                      f"a picture: {script_ms:.2f} ms of script, {tasks_ms:.2f} ms of the page's thread; "
                      + ", ".join(f"{name} {share:.0%}" for share, name in shares), flush=True)
            print(f"shown, while Chromium traces itself: {shown(browser):.1f} pictures a second", flush=True)
            browser.picture(folder / "page.png")
            local = browser.run("performance.getEntriesByType('resource').every((entry) => entry.name.startsWith(location.origin))")
            print(f"{folder}/page.png; requests to this host only: {local}; errors of the console: {browser.problems()}")
    finally:
        for process in [view, *reversed(started)]:
            process.stop()


main()
