"""`--ros-args` against rclpy's own behaviour: the same command lines, then names and parameters compared."""

import json
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest
from conftest import ROOT, TARGET

FILES = {
    "any.yaml": "/**:\n  ros__parameters:\n    rate: 2.0\n    text: any\n",
    "named.yaml": "walker:\n  ros__parameters:\n    rate: 3.0\n    count: 3\n",
    "full.yaml": "/robot/walker:\n  ros__parameters:\n    rate: 4.0\n",
    "nested.yaml": "robot:\n  walker:\n    ros__parameters:\n      rate: 5.0\n",
    "star.yaml": "/*/walker:\n  ros__parameters:\n    rate: 6.0\n",
    "stars.yaml": "/**/walker:\n  ros__parameters:\n    rate: 7.0\n",
    "one_star.yaml": "/*:\n  ros__parameters:\n    rate: 8.0\n",
    "other.yaml": "other:\n  ros__parameters:\n    rate: 9.0\n",
    "specific_first.yaml": "walker:\n  ros__parameters:\n    rate: 10.0\n/**:\n  ros__parameters:\n    rate: 11.0\n",
    "specific_last.yaml": "/**:\n  ros__parameters:\n    rate: 12.0\nwalker:\n  ros__parameters:\n    rate: 13.0\n",
    "groups.yaml": "walker:\n  ros__parameters:\n    group:\n      deep:\n        list: [1.0, 2.5]\n    numbers: [1, 2]\n    words: [a, b c]\n    flags: [true, false]\n",
    "dots.yaml": "walker:\n  ros__parameters:\n    group.deep.list: [1.5]\n",
    "words.yaml": "walker:\n  ros__parameters:\n    flag: yes\n    text: '1'\n    rate: 1e3\n    count: 0x10\n",
    "more_words.yaml": "walker:\n  ros__parameters:\n    flag: On\n    text: !!str 12\n    rate: .inf\n",
    "integer.yaml": "walker:\n  ros__parameters:\n    rate: 3\n",
    "mixed.yaml": "walker:\n  ros__parameters:\n    numbers: [1, 2.0]\n",
    "broken.yaml": "walker:\n  ros__parameters:\n   - rate: [\n",
    "no_key.yaml": "walker:\n  rate: 3.0\n",
}

LINES = """
-r __node:=a
-r __name:=a
-r __node:=a -r __node:=b
-r __ns:=/robot
-r __ns:=robot
-r __ns:=/robot -r __ns:=/other
-r __ns:=/robot/left -r __node:=a
-r walker:__node:=a
-r other:__node:=a
-r walker:__ns:=/robot
-r other:__ns:=/robot
-r chatter:=talk
-r chatter:=/talk
-r /chatter:=talk
-r chatter:=a -r chatter:=b
-r chatter:=a -r a:=b
-r __ns:=/robot -r chatter:=talk
-r __ns:=/robot -r /chatter:=talk
-r __ns:=/robot -r /robot/chatter:=talk
-r a/b:=c
-r ~/state:=here
-r ~/state:=~/there
-r rostopic://chatter:=talk
-r rosservice://chatter:=talk
-r rosservice://add:=plus
-r walker:chatter:=talk
-r other:chatter:=talk
-r __node:=a -r walker:chatter:=talk
-r __node:=a -r a:chatter:=talk
-r /:__node:=a
--remap chatter:=talk
-r chatter:=1talk
-r chatter:=
-r :=talk
-r chatter
-r __ns:=/a//b
-r __ns:=/a/
-r __node:=a/b
-r __node:=1a
-r {node}:=talk
-p rate:=2.5
-p rate:=2
-p rate:=2.5 -p rate:=3.5
-p count:=7
-p count:=7.0
-p flag:=true
-p flag:=yes
-p flag:=1
-p text:=hello
-p text:=7
-p text:='7'
-p text:="a b"
-p numbers:=[1,2,3]
-p numbers:=[1,2.5]
-p words:=[a,b]
-p words:=['1',b]
-p flags:=[true,false]
-p group.deep.list:=[1.0,2.0]
-p walker:rate:=2.5
-p other:rate:=2.5
-p rate:=.nan
-p rate:=1e-3
-p unknown:=3
-p rate
-p :=3
--param rate:=2.5
--params-file any.yaml
--params-file named.yaml
--params-file full.yaml
--params-file full.yaml -r __ns:=/robot
--params-file named.yaml -r __ns:=/robot
--params-file nested.yaml -r __ns:=/robot
--params-file star.yaml
--params-file star.yaml -r __ns:=/robot
--params-file star.yaml -r __ns:=/robot/left
--params-file stars.yaml
--params-file stars.yaml -r __ns:=/robot/left
--params-file one_star.yaml
--params-file one_star.yaml -r __ns:=/robot
--params-file other.yaml
--params-file other.yaml -r __node:=other
--params-file named.yaml -r __node:=other
--params-file specific_first.yaml
--params-file specific_last.yaml
--params-file any.yaml --params-file named.yaml
--params-file named.yaml --params-file any.yaml
--params-file any.yaml -p rate:=20.0
-p rate:=20.0 --params-file any.yaml
--params-file named.yaml -p rate:=20.0
-p rate:=20.0 --params-file named.yaml
-p walker:rate:=20.0 -p rate:=21.0
-p /walker:rate:=20.0
-p /**:rate:=20.0
-p /*:rate:=20.0
-p /**:rate:=20.0 -p walker:rate:=21.0
-p walker:rate:=20.0 -p /**:rate:=21.0
-r __ns:=/robot -p /robot/walker:rate:=20.0
-r __ns:=/robot -p /*/walker:rate:=20.0
-r __node:=a -p walker:rate:=20.0
-r __node:=a -p a:rate:=20.0
--params-file any.yaml -p /**:rate:=20.0
--params-file named.yaml -p /**:rate:=20.0
-p rate:=21.0 -p walker:rate:=20.0
--params-file full.yaml --params-file named.yaml --params-file any.yaml -r __ns:=/robot
--params-file groups.yaml
--params-file dots.yaml
--params-file words.yaml
--params-file more_words.yaml
--params-file integer.yaml
--params-file mixed.yaml
--params-file broken.yaml
--params-file no_key.yaml
--params-file nowhere.yaml
--params-file
--log-level debug
--log-level walker:=debug
--log-level loud
-e /enclave
--enclave /enclave
-e
--disable-rosout-logs
--enable-stdout-logs
--disable-external-lib-logs
--log-file-name left
--log-file-name
--unknown-flag
-x
--
-- other arguments
-p rate:=2.5 -- left --ros-args -p count:=5
""".strip().splitlines()  # fmt: skip

# Where we differ from rclpy on purpose, and why.
STRICTER = {}


@pytest.fixture(scope="module")
def answers(tmp_path_factory):
    """What rclpy and we say of every line."""
    folder = tmp_path_factory.mktemp("arguments")
    for name, text in FILES.items():
        (folder / name).write_text(text)
    lines = [["--ros-args", *line.split(" ")] if "\"" not in line else ["--ros-args", *line.split(" ", 1)] for line in LINES]
    expected = subprocess.run(
        [sys.executable, ROOT / "tests/ros2/arguments_of_rclpy.py"], input=json.dumps(lines), capture_output=True, text=True, check=True, cwd=folder
    )

    def ours(line):
        result = subprocess.run([TARGET / "examples/arguments", *line], capture_output=True, text=True, cwd=folder, timeout=60)
        return json.loads(result.stdout.replace("NaN", '"nan"').replace("inf", "Infinity")) if result.returncode == 0 else {"error": result.stderr.strip()}

    with ThreadPoolExecutor(8) as pool:
        got = list(pool.map(ours, lines))
    theirs = json.loads(expected.stdout.replace("NaN", '"nan"'))
    return dict(zip(LINES, zip(theirs, got, strict=True), strict=True))


@pytest.mark.parametrize("line", LINES)
def test_a_command_line_means_what_it_means_to_rclpy(answers, line):
    theirs, ours = answers[line]
    if line in STRICTER:
        assert STRICTER[line] in ours["error"]
    elif "error" in theirs:
        assert "error" in ours, f"rclpy refuses it ({theirs['error']}), we took it: {ours}"
        # The middleware may have logged before, each line with its time.
        lines = [line for line in ours["error"].splitlines() if not re.match(r"\s*\d{4}-\d\d-\d\dT", line)]
        assert 1 <= len(lines) <= 2, ours["error"]
    else:
        assert ours == theirs
