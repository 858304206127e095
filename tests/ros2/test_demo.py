"""`launch-scripts/demo drive`, its first fourteen seconds: onto the ramp, pushed once, into the first circle."""

import subprocess

from conftest import ROOT


def test_the_robot_of_demo_drive_stays_up_is_drawn_and_its_bag_is_verified(tmp_path):
    demo = [ROOT / "launch-scripts/demo", "drive", "--seconds", "14", "--out", tmp_path]
    done = subprocess.run(demo, capture_output=True, text=True, timeout=550)
    print(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "upright to the end" in done.stdout and "to the bit" in done.stdout, done.stdout
    for name in ("driven.png", "footfalls.png", "time_series.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG"), name
