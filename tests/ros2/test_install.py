"""launch-scripts/install-ros: what `ros2 run` and `ros2 launch` look for, and nodes that run from there."""

import os
import runpy
import subprocess
import sys
import types

import pytest
from conftest import ROOT, Process, wait_until

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


def test_systemd_takes_the_units(prefix, tmp_path):
    units = []
    for unit in sorted((ROOT / "config/systemd").glob("*.service")):
        units.append(tmp_path / unit.name)
        text = unit.read_text()
        assert "/opt/tandem/" in text
        units[-1].write_text(text.replace("/opt/tandem", str(prefix)))
    assert len(units) == 2
    try:
        said = subprocess.run(["systemd-analyze", "verify", "--man=no", *units], capture_output=True, text=True)
    except FileNotFoundError:
        pytest.skip("systemd-analyze is not on this machine")
    assert (said.returncode, said.stderr) == (0, ""), said.stderr


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


class Recorded:
    """Stands for any class of the launch system: keeps what it was made from."""

    made = []

    def __init__(self, *positional, **named):
        self.positional, self.named = positional, named
        Recorded.made.append(self)


def test_launch_files_start_programs_that_exist_with_parameters_that_exist(prefix, monkeypatch):
    # The launch system is on no registry: its classes are stood in for, so this checks names, not its behaviour.
    modules = {
        "launch": ["LaunchDescription"],
        "launch.actions": ["DeclareLaunchArgument", "ExecuteProcess"],
        "launch.conditions": ["IfCondition"],
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
            for parameter in (key for group in node.named["parameters"] for key in group):
                assert f"| `{parameter}` |" in table, f"{file.name}: {program} has no parameter {parameter}"
        for process in (a for a in made if isinstance(a, classes["ExecuteProcess"])):
            joined = next(a for a in made if isinstance(a, classes["PathJoinSubstitution"])).positional[0]
            assert (prefix / "/".join(joined[1:])).exists() and process.named["cmd"][1:3] == ["bag", "play"]
