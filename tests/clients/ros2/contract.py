"""The contract of the node for ROS 2, run in a sourced ROS 2 shell: one line for each clause.

    python3 tests/clients/ros2_contract.py

ROS 2 and the packages of ``rtask ros2 package`` and ``rtask ros messages`` are those of the shell;
RTASK itself runs in its own Python (``--rtask``), for the server and the view of a table. The last
line says with what all of it was run. A clause for which something is absent is "not run", with
the reason. Exit code 0 if all that could be run passed, 1 if a clause fails, 2 if none could be
run. It ends by itself: each clause has a limit, and so has the whole.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import os
import platform
import re
import shutil
import subprocess
import sys
import threading
import time
import traceback
from pathlib import Path

from tests.clients.ros2 import clauses, endings, grasping, images, surroundings
from tests.clients.ros2.programs import ROOT, Program, Shell, own_python
from tests.clients.ros2.registry import clauses_of
from tests.clients.ros2.robot import Robot
from tests.clients.ros2.views import View

CLOSING_S = 60.0
RMEM_MAX = Path("/proc/sys/net/core/rmem_max")
CLAUSES = clauses_of(clauses, grasping, images, surroundings, endings)
NEEDED = {
    "rclpy": "source a ROS 2",
    "rtask_msgs.srv": "rtask ros messages ~/ws/src, colcon build, source install/setup.bash",
    "moveit_msgs.msg": "apt-get install ros-$ROS_DISTRO-moveit-msgs",
    "tf2_msgs.msg": "apt-get install ros-$ROS_DISTRO-tf2-msgs",
    "visualization_msgs.msg": "apt-get install ros-$ROS_DISTRO-visualization-msgs",
    "numpy": "apt-get install python3-numpy",
    "websockets.sync.client": "pip install 'websockets>=15'",
}
"""What every clause needs in the Python of ROS 2, and what brings it."""


def about():
    """Return with what the contract is run."""
    import importlib.metadata as metadata

    from rclpy.utilities import get_rmw_implementation_identifier

    version = ""
    for name in ("ros-rclpy", "rclpy"):
        with contextlib.suppress(metadata.PackageNotFoundError):
            version = version or metadata.version(name)
    distribution = os.environ.get("ROS_DISTRO", "an unnamed ROS 2")
    return (
        f"rclpy {version or '?'} of {distribution}, {get_rmw_implementation_identifier()}, "
        f"Python {platform.python_version()}"
    )


def absent(options):
    """Return why no clause can be run here; empty if they can."""
    for name, remedy in NEEDED.items():
        try:
            importlib.import_module(name)
        except ImportError as error:
            return f"no {name.partition('.')[0]} in this shell: {error}; {remedy}"
    if shutil.which(options.rtask.split()[0]) is None:
        return f"no {options.rtask}: give --rtask, the command of an installed RTASK"
    if not options.node:
        return (
            "no node in this shell: rtask ros2 package ~/ws/src, colcon build, source "
            "install/setup.bash; or give --node"
        )
    return ""


def node_command():
    """Return the command of the node that this shell has, or none: by ros2 run, colcon or pip."""
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    built = [Path(prefix, "lib/rtask_ros2/node") for prefix in prefixes if prefix]
    found = [str(file) for file in built if file.is_file()]
    if found:
        # The command ros2 is a package of its own, which a small ROS 2 may lack.
        return (
            "ros2 run rtask_ros2 node" if shutil.which("ros2") else f"{sys.executable} {found[0]}"
        )
    return shutil.which("rtask-ros2-node") or ""


def widen_buffers():
    """Let Cyclone receive large clouds on a busy machine, as docs/ros.md says; return how.

    With the default buffer most are lost there, whatever the node does.
    """
    from rclpy.utilities import get_rmw_implementation_identifier

    is_cyclone = "cyclone" in get_rmw_implementation_identifier()
    if not is_cyclone or "CYCLONEDDS_URI" in os.environ:
        return ""
    try:
        may_ask_for = int(RMEM_MAX.read_text("ascii"))
    except (OSError, ValueError):
        return ""
    if may_ask_for < 4 * 2**20:
        return ""
    os.environ["CYCLONEDDS_URI"] = (
        "<CycloneDDS><Domain><Internal><SocketReceiveBufferSize min='4MB'/></Internal></Domain>"
        "</CycloneDDS>"
    )
    return ", SocketReceiveBufferSize 4MB"


def parsed():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    own = ROOT / ".venv/bin/rtask"
    parser.add_argument("--rtask", default=str(own) if own.exists() else "rtask",
                        help="command of RTASK, in its own Python")  # fmt: skip
    parser.add_argument("--node", default=node_command(), help="command of the node")
    parser.add_argument("--reach", default=sys.executable, metavar="PYTHON",
                        help="Python with RTASK and rclpy, for the clauses on arms")  # fmt: skip
    parser.add_argument("--only", default="", help="regular expression of clauses to run")
    parser.add_argument("--clause-limit", type=float, default=180.0, metavar="S",
                        help="longest time for one clause, s")  # fmt: skip
    parser.add_argument("--limit", type=float, default=1200.0, metavar="S",
                        help="longest time for all of them, s")  # fmt: skip
    return parser.parse_args()


def main():
    """Run all clauses and return the exit code."""
    options = parsed()
    chosen = [each for each in CLAUSES if re.search(options.only, each[0])]
    reason = absent(options)
    if reason:
        for words, _ in chosen:
            say("not run", words, reason)
        print(f"{len(chosen)} clauses, none run: {reason}")
        return 2
    with_what, until = about() + widen_buffers(), time.monotonic() + options.limit
    shell, states = Shell(options), []
    try:
        reason = within(options.clause_limit, lambda: prepare(shell)).strip()
        for words, check in chosen:
            left_s = min(options.clause_limit, until - time.monotonic())
            if reason or left_s <= 0:
                states.append("FAILED" if reason else "not run")
                say(states[-1], words, reason or f"the {options.limit:g} s for all were over")
                continue
            states.append(run(shell, words, check, left_s))
    finally:
        within(CLOSING_S, shell.close)
        Program.kill_all()
    failed, left_out = states.count("FAILED"), states.count("not run")
    print(
        f"{len(states)} clauses, {failed} failed, {left_out} not run; run with {with_what}",
        flush=True,
    )
    return 1 if failed else 0


def prepare(shell):
    """Start the server and the node of a robot, and make a view of a table."""
    view = shell.folder / "view.npz"
    own = Path(shutil.which(shell.options.rtask.split()[0])).with_name("python")
    made = subprocess.run(
        [str(own), "-m", "tests.rtask.ros2.view_file", str(view)], cwd=ROOT, env=own_python(),
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert made.returncode == 0, made.stderr[-600:]
    shell.contract, shell.view = made.stdout, View(view)
    shell.start_server()
    shell.robot = Robot()
    return ""


def run(shell, words, check, limit_s):
    """Run one clause, print its line, and return how it ended."""
    began = time.monotonic()
    note = within(limit_s, lambda: check(shell) or "")
    state = "ok"
    for ending in ("not run", "FAILED"):
        if note.startswith(ending):
            state, note = ending, note.removeprefix(ending).strip(" :")
    say(state, words, note, time.monotonic() - began)
    return state


def within(limit_s, action):
    """Return the words of an action; those of one that fails or does not end begin with FAILED."""
    said = []

    def act():
        try:
            said.append(action() or "")
        except Exception as error:  # noqa: BLE001 - the other clauses are run all the same
            frames = traceback.extract_tb(error.__traceback__)
            at = next((f for f in frames if f.name == "_"), frames[-1])  # the clause's own line
            said.append(f"FAILED: {error!r:.3000} at line {at.lineno} of {Path(at.filename).name}")

    # One that hangs is left behind: it ends with this process.
    thread = threading.Thread(target=act, daemon=True)
    thread.start()
    thread.join(limit_s)
    return said[0] if said else f"FAILED: no end within {limit_s:.0f} s"


def say(state, words, note, took_s=None):
    note = f" ({note})" if note else ""
    took = "" if took_s is None else f" [{took_s:.1f} s]"
    print(f"{state:<8}{words}{note}{took}", flush=True)


def run_and_exit():
    """End the process with the exit code, whatever thread of a clause still waits."""
    code = 1
    try:
        code = main()
    except SystemExit as ended:  # of the command line
        code = int(ended.code or 0)
    except (AssertionError, OSError, RuntimeError, KeyboardInterrupt):
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


if __name__ == "__main__":
    run_and_exit()
