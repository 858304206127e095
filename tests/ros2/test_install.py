"""launch-scripts/install-ros: what `ros2 run` and `ros2 launch` look for, and nodes that run from there."""

import os
import runpy
import subprocess
import sys
import types

import pytest
from conftest import ROOT, TARGET, Process, wait_until

PROGRAMS = {
    "tandem_planner": "tandem_planner",
    "tandem_controller": "tandem_controller",
    "tandem_sim_bridge": "tandem_sim_bridge",
    "tandem_cli": "tandem",
}


@pytest.fixture(scope="module")
def prefix(tmp_path_factory):
    folder = tmp_path_factory.mktemp("installed") / "prefix"
    subprocess.run([ROOT / "launch-scripts/install-ros", folder, "--built"], check=True, capture_output=True, text=True)
    return folder


def test_the_package_index_knows_every_package(prefix, monkeypatch):
    from ament_index_python.packages import get_package_prefix, get_package_share_directory

    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{prefix}:{os.environ.get('AMENT_PREFIX_PATH', '')}")
    for package in [*PROGRAMS, "tandem"]:
        assert get_package_prefix(package) == str(prefix)
        assert f"<name>{package}</name>" in (prefix / "share" / package / "package.xml").read_text()
        assert get_package_share_directory(package) == str(prefix / "share" / package)


def test_manual_pages_and_completions_are_installed(prefix):
    pages = {page.name for page in (prefix / "share/man/man1").iterdir()}
    assert {"tandem.1", "tandem-plan.1", "tandem-bag-play.1", "tandem-stop-button.1"} <= pages
    completions = ["bash-completion/completions/tandem", "zsh/site-functions/_tandem", "fish/vendor_completions.d/tandem.fish"]
    assert all("stop-button" in (prefix / "share" / file).read_text() for file in completions)
    # A shell that completes `tandem bag p` offers play.
    words = 'COMP_WORDS=(tandem bag p); COMP_CWORD=2; _tandem tandem p bag; printf "%s " "${COMPREPLY[@]}"'
    script = f"source {prefix}/share/bash-completion/completions/tandem; {words}"
    offered = subprocess.run(["bash", "-c", script], check=True, capture_output=True, text=True).stdout.split()
    assert offered == ["play"]


def test_systemd_takes_the_units(prefix, tmp_path):
    units = []
    for unit in sorted((ROOT / "config/systemd").glob("*.service")):
        units.append(tmp_path / unit.name)
        text = unit.read_text()
        assert "/opt/tandem/" in text
        units[-1].write_text(text.replace("/opt/tandem", str(prefix)))
    assert len(units) == 2
    try:
        result = subprocess.run(["systemd-analyze", "verify", "--man=no", *units], capture_output=True, text=True)
    except FileNotFoundError:
        pytest.skip("systemd-analyze is not on this machine")
    assert (result.returncode, result.stderr) == (0, ""), result.stderr


def test_the_wrong_arguments_are_refused(tmp_path):
    for arguments in [[], ["--prefix", "x"], [tmp_path / "a", tmp_path / "b"]]:
        result = subprocess.run([ROOT / "launch-scripts/install-ros", *arguments], capture_output=True, text=True)
        assert result.returncode == 2 and result.stderr.startswith("install-ros: expected"), result


def test_installed_nodes_find_their_files_and_libraries_from_anywhere(prefix, client, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    started = {}
    for package, program in PROGRAMS.items():
        path = prefix / "lib" / package / program
        if package == "tandem_cli":
            text = subprocess.run([path, "--help"], check=True, capture_output=True, text=True, cwd=tmp_path).stdout
            assert "simulate" in text
            continue
        libraries = subprocess.run(["ldd", path], check=True, capture_output=True, text=True).stdout
        if package == "tandem_sim_bridge":
            assert str(prefix / "lib") in libraries.split("libmujoco.so", 1)[1].splitlines()[0], libraries
        started[program] = Process(path, ["--ros-args", "-r", "__ns:=/installed"], tmp_path / f"{program}.log")
    expected = {program.removeprefix("tandem_") for program in started}

    def seen():
        for process in started.values():
            assert process.alive(), process.text()
        return expected <= {
            name for name, namespace in client.node.get_node_names_and_namespaces() if namespace == "/installed"
        }

    try:
        wait_until(seen, 30, "the installed nodes are seen")
    finally:
        for process in started.values():
            process.stop()


@pytest.fixture
def launched(prefix, tmp_path, monkeypatch):
    """Starts one of the installed launch files with ROS 2's launch system (launch, launch_ros), which is on no registry: where it is not
    on the Python path, TANDEM_LAUNCH_PATH says where it is."""
    path = os.environ.get("TANDEM_LAUNCH_PATH", "")
    found = subprocess.run(
        [sys.executable, "-c", "import launch"], env={**os.environ, "PYTHONPATH": path}, capture_output=True
    )
    if found.returncode:
        pytest.skip("ROS 2's launch system is not here; TANDEM_LAUNCH_PATH may say where its sources are")
    monkeypatch.setenv("PYTHONPATH", path)
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{prefix}:{sys.prefix}")
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    started = []

    def start(name, *arguments):
        file = prefix / "share/tandem/launch" / f"{name}.launch.py"
        command = [ROOT / "tests/ros2/launched.py", file, *arguments]
        started.append(Process(sys.executable, command, tmp_path / f"{name}.log"))
        return started[-1]

    yield start
    for process in started:
        process.stop(seconds=20)


def names_in(client, namespace):
    return {name for name, where in client.node.get_node_names_and_namespaces() if where == namespace}


def values_of(client, node, names):
    from rcl_interfaces.srv import GetParameters
    from rclpy.parameter import parameter_value_to_python

    get = client.service(GetParameters, f"{node}/get_parameters")
    values = client.call(get, GetParameters.Request(names=list(names))).values
    return dict(zip(names, map(parameter_value_to_python, values), strict=True))


def test_ros_2_launches_the_simulation(client, launched):
    from sensor_msgs.msg import JointState
    from test_walk import best_effort

    process = launched("simulation", "namespace:=sim", "terrain:=rough", "initial_posture:=stand")
    received = []
    client.node.create_subscription(JointState, "/sim/joint_states", received.append, best_effort(1))
    wait_until(lambda: received, 40, process.text)
    wait_until(lambda: names_in(client, "/sim") >= {"planner", "controller", "sim_bridge"}, 20, process.text)
    expected = {"mode": "realtime", "terrain": "rough", "initial_posture": "stand"}
    assert values_of(client, "/sim/sim_bridge", expected) == expected
    assert process.stop(seconds=20) == 0, process.text()
    assert process.text().count("process has finished cleanly") == 3, process.text()


def test_ros_2_launches_the_planner_alone(client, launched):
    from tandem_msgs.srv import GenerateGait

    process = launched("planner", "namespace:=far")
    plan = client.service(GenerateGait, "/far/generate_gait")
    assert client.call(plan, GenerateGait.Request(behaviour="amble")).success, process.text()


def test_ros_2_launches_the_hardware(client, launched):
    from lifecycle_msgs.srv import ChangeState, GetState

    process = launched("hardware", "namespace:=real", "autostart:=false", "core:=1")
    wait_until(lambda: names_in(client, "/real") >= {"planner", "controller"}, 40, process.text)
    expected = {
        "backend": "can", "core": 1, "autostart": False, "emergency_stop_heartbeat_s": 0.5, "robot": "config/robots/vision60",
        "bus_file": "config/hardware/vision60_can.toml",
    }  # fmt: skip
    assert values_of(client, "/real/controller", expected) == expected
    state = client.service(GetState, "/real/controller/get_state")
    assert client.call(state, GetState.Request()).current_state.label == "unconfigured"
    if not os.path.exists("/sys/class/net/can0"):
        # Without the robot's buses it stays where it is, and says which one it misses.
        change = client.service(ChangeState, "/real/controller/change_state")
        request = ChangeState.Request()
        request.transition.id = 1
        assert not client.call(change, request).success
        assert client.call(state, GetState.Request()).current_state.label == "unconfigured"
        wait_until(lambda: "can0" in process.text(), 5, process.text)
    alone = launched("hardware", "namespace:=alone", "autostart:=false", "planner:=false")
    wait_until(lambda: names_in(client, "/alone") >= {"controller"}, 40, alone.text)
    assert "tandem_planner" not in alone.text()


def test_ros_2_launches_a_replay(client, launched, tmp_path):
    from test_walk import best_effort
    from sensor_msgs.msg import JointState

    tandem = TARGET / "tandem"
    subprocess.run([tandem, "plan", "gait1", "-o", tmp_path / "gait1.json"], check=True, capture_output=True, cwd=ROOT)
    command = [tandem, "simulate", tmp_path / "gait1.json", "--seconds", "10", "--bag", tmp_path / "run"]
    subprocess.run(command, check=True, capture_output=True, cwd=ROOT)
    received = []
    client.node.create_subscription(JointState, "/joint_states", received.append, best_effort(10))
    process = launched("replay", f"bag:={tmp_path / 'run'}", "rate:=2.0")
    wait_until(lambda: len(received) > 100, 30, process.text)
    assert len(received[-1].name) == 12 and len(received[-1].position) == 12
    wait_until(lambda: not process.alive(), 30, process.text)
    assert process.process.returncode == 0 and "process has finished cleanly" in process.text(), process.text()


class Recorded:
    """Stands for any class of the launch system: keeps what it was made from."""

    made = []

    def __init__(self, *positional, **named):
        self.positional, self.named = positional, named
        Recorded.made.append(self)


def test_launch_files_start_programs_that_exist_with_parameters_that_exist(prefix, monkeypatch):
    # Where the launch system is not, its classes are stood in for: this checks names, not its behaviour.
    modules = {
        "launch": ["LaunchDescription"],
        "launch.actions": ["DeclareLaunchArgument", "ExecuteProcess"],
        "launch.conditions": ["IfCondition", "UnlessCondition"],
        "launch.substitutions": ["LaunchConfiguration", "PathJoinSubstitution"],
        "launch_ros": [],
        "launch_ros.actions": ["Node"],
        "launch_ros.parameter_descriptions": ["ParameterValue"],
        "launch_ros.substitutions": ["FindPackagePrefix"],
    }
    classes = {}
    for module, names in modules.items():
        stand_in = types.ModuleType(module)
        for name in names:
            classes[name] = type(name, (Recorded,), {})
            setattr(stand_in, name, classes[name])
        monkeypatch.setitem(sys.modules, module, stand_in)
    interfaces = (ROOT / "docs/interfaces.md").read_text()
    files = sorted((prefix / "share/tandem/launch").glob("*.launch.py"))
    assert {file.name for file in files} == {
        f"{name}.launch.py" for name in ["hardware", "planner", "replay", "simulation"]
    }
    for file in files:
        Recorded.made.clear()
        description = runpy.run_path(str(file))["generate_launch_description"]()
        made = list(Recorded.made)
        assert isinstance(description, classes["LaunchDescription"])
        declared = {a.positional[0] for a in made if isinstance(a, classes["DeclareLaunchArgument"])}
        used = {a.positional[0] for a in made if isinstance(a, classes["LaunchConfiguration"])}
        assert used == declared, f"{file.name}: declared {declared}, used {used}"
        for node in (a for a in made if isinstance(a, classes["Node"])):
            package, program = node.named["package"], node.named["executable"]
            assert (prefix / "lib" / package / program).exists(), f"{file.name}: {package}/{program}"
            name = program.removeprefix("tandem_")
            table = interfaces.split(f"<!-- parameters: {name} -->", 1)[1].split("<!-- end -->", 1)[0]
            # Every node has use_sim_time, which no table repeats; the simulation has the time itself.
            parameters = {key for group in node.named["parameters"] for key in group}
            assert ("use_sim_time" in parameters) == (program != "tandem_sim_bridge"), f"{file.name}: {program}"
            for parameter in parameters - {"use_sim_time"}:
                assert f"| `{parameter}` |" in table, f"{file.name}: {program} has no parameter {parameter}"
        for process in (a for a in made if isinstance(a, classes["ExecuteProcess"])):
            joined = next(a for a in made if isinstance(a, classes["PathJoinSubstitution"])).positional[0]
            assert (prefix / "/".join(joined[1:])).exists() and process.named["cmd"][1:3] == ["bag", "play"]
