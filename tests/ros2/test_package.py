"""launch-scripts/make-deb: a Debian package, installed into a root of its own, run from there, and removed without a trace."""

import os
import shutil
import subprocess

import pytest
from conftest import ROOT

PROGRAMS = ["tandem", "tandem_controller", "tandem_planner", "tandem_sim_bridge"]


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    if not shutil.which("dpkg-deb"):
        pytest.skip("dpkg-deb is not on this machine")
    folder = tmp_path_factory.mktemp("deb")
    subprocess.run([ROOT / "launch-scripts/make-deb", folder, "--built"], check=True, capture_output=True, text=True)
    (package,) = folder.glob("tandem_*.deb")
    return package


def field(package, name):
    return subprocess.run(["dpkg-deb", "--field", package, name], check=True, capture_output=True, text=True).stdout.strip()


def test_the_package_says_what_it_is(package):
    version = next(line.split('"')[1] for line in (ROOT / "Cargo.toml").read_text().splitlines() if line.startswith("version"))
    assert (field(package, "Package"), field(package, "Version")) == ("tandem", version)
    assert field(package, "Depends").startswith("libc6 (>= 2.")
    listing = subprocess.run(["dpkg-deb", "--contents", package], check=True, capture_output=True, text=True).stdout
    assert all("root/root" in line for line in listing.splitlines())


@pytest.mark.skipif(os.geteuid() != 0, reason="dpkg installs as root only, also into another root")
def test_it_is_installed_runs_from_anywhere_and_is_removed(package, tmp_path):
    root = tmp_path / "root"
    (root / "var/lib/dpkg").mkdir(parents=True)
    (root / "var/lib/dpkg/status").touch()
    # What it depends on is this machine's and not this empty root's.
    dpkg = ["dpkg", f"--root={root}", "--force-depends", "--log=/dev/null"]
    subprocess.run([*dpkg, "--install", package], check=True, capture_output=True, text=True)
    for program in PROGRAMS:
        link = os.readlink(root / "usr/bin" / program)
        assert link.startswith("/opt/tandem/lib/") and os.access(root / link[1:], os.X_OK), link
    tandem, gait = root / "opt/tandem/lib/tandem_cli/tandem", tmp_path / "amble.json"
    run = lambda *words: subprocess.run([tandem, *words], check=True, capture_output=True, text=True, cwd=tmp_path)
    run("plan", "amble", "-o", gait)
    run("simulate", gait, "--seconds", "3")
    libraries = subprocess.run(["ldd", tandem], check=True, capture_output=True, text=True).stdout
    assert str(root / "opt/tandem/lib") in libraries.split("libmujoco.so", 1)[1].splitlines()[0], "its own MuJoCo, not the clone's"
    assert (root / "usr/share/man/man1/tandem-plan.1.gz").exists()
    subprocess.run([*dpkg, "--purge", "tandem"], check=True, capture_output=True, text=True)
    left = [path for path in root.rglob("*") if "tandem" in path.name and "var/lib/dpkg" not in str(path)]
    assert not left, left
