"""tandem show --web: the page, what is sent to it, and its stop button, beside controller and simulation on the wall clock."""

import http.client
import json
import re
import shutil
import statistics
import subprocess
import threading
import time

import pytest
from conftest import ROOT, Client, wait_until

NAMESPACE = "/web"
HEARTBEAT_S = 1.0
SEEN_WITHIN_S = 5.0
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


class View:
    """`tandem show --web` on a free port."""

    def __init__(self, processes):
        self.process = processes("tandem", "show", "--web=0", "--ros-args", "-r", f"__ns:={NAMESPACE}", name="web")
        found = wait_until(lambda: re.search(r"http://127\.0\.0\.1:(\d+) ", self.process.text()), 20, self.process.text)
        self.port = int(found[1])
        self.origin = f"http://127.0.0.1:{self.port}"
        status, self.headers, self.page = self.ask("GET", "/")
        assert status == 200
        self.token = re.search(r'const TOKEN = "([0-9a-f]{32})"', self.page)[1]

    def ask(self, method, path, **headers):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=10)
        try:
            connection.request(method, path, headers={name.replace("_", "-"): value for name, value in headers.items()})
            answer = connection.getresponse()
            return answer.status, answer.headers, answer.read().decode()
        finally:
            connection.close()

    def press(self, path="/press"):
        return self.ask("POST", path, Origin=self.origin, X_Tandem_Token=self.token)[0]

    def events(self, seconds):
        """[(time of arrival, frame)] of so many seconds."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=10)
        connection.request("GET", "/events")
        answer = connection.getresponse()
        assert (answer.status, answer.headers["Content-Type"]) == (200, "text/event-stream")
        frames, end = [], time.monotonic() + seconds
        while time.monotonic() < end:
            line = answer.readline().decode()
            assert line, "the stream ended"
            if line.startswith("data: "):
                frames.append((time.monotonic(), json.loads(line[6:])))
        connection.close()
        return frames

    def frame(self):
        return self.events(0.3)[-1][1]


class Robot:
    """Controller and simulation in realtime, and an operator whose stop button is a heartbeat."""

    def __init__(self, processes, ros):
        from std_msgs.msg import Bool
        from tandem_msgs.msg import ControllerState

        remap = ["--ros-args", "-r", f"__ns:={NAMESPACE}"]
        set_ = lambda *values: [part for value in values for part in ("-p", value)]
        # A machine that runs tests stands still for tenths of a second.
        patience = ["state_timeout_s:=1.0", "overrun_s:=1.0", "middleware_timeout_s:=1.0", "posture_speed_rad_s:=3.0"]
        self.nodes = [
            processes("tandem_controller", *remap, *set_(*patience, f"emergency_stop_heartbeat_s:={HEARTBEAT_S}")),
            processes("tandem_sim_bridge", *remap, *set_("command_timeout_s:=1.0")),
        ]
        self.states = []
        self.client = Client("operator")
        self.client.node.create_subscription(ControllerState, f"{NAMESPACE}/controller_state", self.states.append, 100)
        self.button = self.client.node.create_publisher(Bool, f"{NAMESPACE}/emergency_stop", 10)
        self.held = True
        self.hand = threading.Thread(target=self.hold, daemon=True)
        self.hand.start()
        self.services = {}
        wait_until(lambda: self.states, 30, "controller_state")

    def hold(self):
        from std_msgs.msg import Bool

        while self.held is not None:
            if self.held:
                self.button.publish(Bool(data=False))
            time.sleep(0.05)

    def trigger(self, name):
        from std_srvs.srv import Trigger

        if name not in self.services:
            self.services[name] = self.client.service(Trigger, f"{NAMESPACE}/{name}")
        answer = self.client.call(self.services[name], Trigger.Request())
        assert answer.success, f"{name}: {answer.message}"

    def stand(self):
        self.trigger("disarm")
        self.wait_for("disarmed")
        deadline = time.monotonic() + 20
        put_down = False
        while True:
            # Until the simulation answers, and the robot has come to rest where it was put.
            try:
                if not put_down:
                    self.trigger("reset")
                    put_down = True
                self.trigger("arm")
                self.trigger("stand")
                break
            except AssertionError:
                assert time.monotonic() < deadline, self.states[-1]
                time.sleep(0.2)
        self.wait_for("standing")

    def wait_for(self, mode, seconds=30):
        wait_until(lambda: self.states[-1].mode == mode, seconds, lambda: f"{mode}; it is {self.states[-1]}")

    def close(self):
        self.held = None
        self.hand.join()
        self.client.close()
        for node in self.nodes:
            assert node.stop() == 0, node.text()


@pytest.fixture(scope="module")
def robot(processes, ros):
    robot = Robot(processes, ros)
    yield robot
    robot.close()


@pytest.fixture(scope="module")
def view(processes, robot):
    view = View(processes)
    yield view
    assert view.process.stop() == 0, view.process.text()


def test_the_page_needs_nothing_from_elsewhere_and_is_in_no_other_page_s_frame(view):
    policy = view.headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy and "connect-src 'self'" in policy and "frame-ancestors 'none'" in policy
    assert "unsafe" not in policy and view.headers["X-Frame-Options"] == "DENY"
    assert "://" not in view.page and "src=" not in view.page and "@import" not in view.page and "url(" not in view.page
    assert "__" not in re.sub(r"[a-z]__[a-z]", "", view.page), "everything is filled in"
    # Each page has a nonce of its own; the token is the program's.
    again = view.ask("GET", "/")[2]
    nonce = lambda page: re.search(r'nonce="([0-9a-f]{32})"', page)[1]
    assert nonce(again) != nonce(view.page) and view.token in again


def test_events_come_at_their_rate_with_the_robot_as_it_is(robot, view):
    wait_until(lambda: view.frame()["points"], 20, "joint states at the page")
    frames = view.events(3)
    intervals = [b[0] - a[0] for a, b in zip(frames, frames[1:])]
    print(f"{len(frames)} events in 3 s, median {statistics.median(intervals) * 1e3:.1f} ms, {len(json.dumps(frames[-1][1]))} bytes")
    assert 0.025 < statistics.median(intervals) < 0.045, "30 a second"
    numbers = [frame["n"] for _, frame in frames]
    assert numbers == sorted(set(numbers))
    frame = wait_until(lambda: (frame := view.frame())["body"] and frame["diagnostics"] and frame, 10, "odom and diagnostics")
    assert len(frame["points"]) == 3 * 17 and all(force is not None for force in frame["force"])
    assert frame["state"]["mode"] == robot.states[-1].mode
    assert frame["age"]["joints"] < 0.5 and frame["age"]["odom"] < 1.0
    assert any("controller" in name for _, name, _ in frame["diagnostics"]), frame["diagnostics"]
    assert frame["stop"] == {"pressed": False, "listeners": 1, "failure": None}


def test_another_page_and_another_name_of_this_machine_are_refused(robot, view):
    own = {"Origin": view.origin, "X_Tandem_Token": view.token}
    before = view.frame()["stop"]
    for path in ("/press", "/release"):
        for wrong in (
            {"Origin": "http://robot.example"},
            {"Origin": "null"},
            {"Host": f"robot.example:{view.port}"},
            {"Sec_Fetch_Site": "cross-site"},
            {"X_Tandem_Token": "0" * 32},
        ):
            assert view.ask("POST", path, **{**own, **wrong})[0] == 403, wrong
        assert view.ask("POST", path, X_Tandem_Token=view.token)[0] == 403
        assert view.ask("GET", path, **own)[0] == 405
        assert view.ask("OPTIONS", path, **own)[0] == 405
    assert view.ask("GET", "/", Host="robot.example")[0] == 403
    assert view.ask("GET", "/events", Origin="http://robot.example")[0] == 403
    assert view.frame()["stop"] == before


def test_requests_that_are_too_large_or_too_slow_hold_up_no_press(view):
    import socket

    assert view.ask("GET", "/", X_Large="x" * 10000)[0] == 431
    assert view.ask("POST", "/press", Origin=view.origin, X_Tandem_Token=view.token, Content_Length="7")[0] == 413
    open_ = [socket.create_connection(("127.0.0.1", view.port)) for _ in range(24)]
    begun = time.monotonic()
    assert view.press("/release") == 200
    print(f"answered in {(time.monotonic() - begun) * 1e3:.1f} ms beside {len(open_)} connections that say nothing")
    # More than are served at once: those that say nothing are let go of, and the next is served.
    open_ += [socket.create_connection(("127.0.0.1", view.port)) for _ in range(100)]

    def served():
        try:
            return view.press("/release") == 200
        except (ConnectionError, http.client.HTTPException):
            return False

    wait_until(served, 10, "a place for the page")
    for connection in open_:
        connection.close()


def test_an_open_page_is_no_heartbeat_and_a_press_damps_until_the_page_releases(robot, view):
    robot.stand()
    stream = threading.Thread(target=view.events, args=(8,), daemon=True)
    stream.start()
    # The operator's own button falls silent: the open page does not stand in for it.
    robot.held = False
    wait_until(lambda: robot.states[-1].fault == "emergency_stop", SEEN_WITHIN_S, lambda: robot.states[-1])
    robot.held = True
    robot.stand()
    begun = time.monotonic()
    assert view.press() == 200
    wait_until(lambda: robot.states[-1].mode == "damping" and robot.states[-1].fault == "emergency_stop", SEEN_WITHIN_S, lambda: robot.states[-1])
    print(f"damped, seen by a client {(time.monotonic() - begun) * 1e3:.0f} ms after the press")
    frame = view.frame()
    assert frame["stop"]["pressed"] and frame["state"]["mode"] == "damping"
    # Longer than the heartbeat: it is repeated, and what another button sends does not take it back.
    time.sleep(3 * HEARTBEAT_S)
    assert view.frame()["stop"]["pressed"] and robot.states[-1].fault == "emergency_stop"
    assert view.press("/release") == 200
    wait_until(lambda: not view.frame()["stop"]["pressed"], 5, "released")
    time.sleep(0.3)
    assert robot.states[-1].mode == "damping", "releasing moves nothing"
    robot.stand()
    # The page says that it is released, on and on.
    time.sleep(1 + 3 * HEARTBEAT_S)
    assert robot.states[-1].mode == "standing", robot.states[-1]
    stream.join()


# Of a robot whose ground forces change: lines drawn for a picture after 0.75 m and after 22 m straight ahead; canvases
# made for 60 pictures, and how often the page's layout gave one of its two another size meanwhile.
COUNT_DRAWN = """(async () => {
  let lines = 0, canvases = 0, resized = 0;
  const watch = new ResizeObserver((entries) => { resized += entries.length; });
  for (const { canvas } of sheets) watch.observe(canvas);
  // It reports both when it begins; a picture later what was resized before is painted.
  for (let n = 0; n < 3; n++) await new Promise(requestAnimationFrame);
  resized = 0;
  const lineTo = CanvasRenderingContext2D.prototype.lineTo, received = take, Plain = OffscreenCanvas;
  CanvasRenderingContext2D.prototype.lineTo = function (...at) { lines++; return lineTo.apply(this, at); };
  OffscreenCanvas = class extends Plain { constructor(...size) { super(...size); canvases++; } };
  take = (frame) => received({ ...frame, force: frame.force.map((force) => force && [force[0], force[1], 100 + 40 * (frame.n % 7)]) });
  const walked = (points) => { trail.length = 0; for (let n = points; n >= 0; n--) trail.push([newest.points[0] - 30 * n, newest.points[1]]); };
  const count = async (points) => {
    walked(points); lines = 0;
    for (let n = 0; n < 30; n++) await new Promise(requestAnimationFrame);
    return lines / 30;
  };
  return { short: await count(25), long: await count(749), canvases, resized };
})()"""


@pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium: apt-get install chromium")
def test_pictures_do_not_become_slower_as_the_robot_walks_on(robot, view, tmp_path):
    if robot.states[-1].mode != "standing":
        robot.stand()
    from at_browser import Browser

    with Browser(CHROMIUM, tmp_path / "profile", f"{view.origin}/") as browser:
        browser.wait("document.body?.dataset.ready === 'yes' && frames.length > 10 && newest.points && newest.force.every(Boolean)", 20)
        drawn = browser.run(COUNT_DRAWN)
        print(f"lines a picture: {drawn['short']:.0f} after 0.75 m, {drawn['long']:.0f} after 22 m")
        assert drawn["short"] > 50, "grid, legs and forces are drawn"
        # 22 m are 749 pieces, of which few are longer than five pixels of the screen.
        assert drawn["long"] < drawn["short"] + 150
        assert 0 <= drawn["resized"] < 6, "the layout stands still"
        assert drawn["canvases"] <= drawn["resized"], "a canvas is made for a new size, and none for a picture"
        assert browser.problems() == []


@pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium: apt-get install chromium")
def test_the_page_works_in_chromium(robot, view, tmp_path):
    """Chromium on the page itself: no error of the console, the robot moves on the canvas, the button stops the robot."""
    if robot.states[-1].mode != "standing":
        robot.stand()
    from at_browser import Browser

    with Browser(CHROMIUM, tmp_path / "profile", f"{view.origin}/") as browser:
        browser.wait("document.body?.dataset.ready === 'yes' && frames.length > 10", 20)
        assert browser.run("document.getElementById('mode').textContent") == "standing"
        assert browser.run("[...document.querySelectorAll('canvas')].every((c) => c.getContext('2d').getImageData(0, 0, c.width, c.height).data.some((x) => x))")
        assert browser.run("document.documentElement.scrollWidth <= innerWidth")
        browser.run("document.getElementById('press').click()")
        wait_until(lambda: robot.states[-1].fault == "emergency_stop", SEEN_WITHIN_S, lambda: robot.states[-1])
        browser.wait("document.getElementById('press').textContent === 'PRESSED' && document.getElementById('stop-state').textContent.includes('damping')", 5)
        browser.picture(tmp_path / "pressed.png")
        browser.run("document.getElementById('release').click()")
        browser.wait("document.getElementById('press').textContent === 'STOP'", 5)
        drawn = browser.run("new Promise((done) => { let n = 0; const begin = performance.now(); const tick = () => { n++; performance.now() - begin > 2000 ? done(n / 2) : requestAnimationFrame(tick); }; tick(); })")
        print(f"{drawn:.0f} pictures a second on this machine's processor; {tmp_path}/pressed.png")
        assert browser.run("performance.getEntriesByType('resource').every((entry) => entry.name.startsWith(location.origin))")
        assert browser.problems() == []
