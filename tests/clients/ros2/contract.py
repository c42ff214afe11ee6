"""The contract of the node for ROS 2, run in a sourced ROS 2 shell: one line for each clause.

    python3 -m tests.clients.ros2.contract

ROS 2 and the packages of ``rtask ros2 package`` and ``rtask ros messages`` are those of the shell;
RTASK itself runs in its own Python (``--rtask``), for the server and the view of a table. The last
line says with what all of it was run. Exit code 1 if a clause fails.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import platform
import re
import subprocess
import sys
import time
import traceback
from pathlib import Path

from tests.clients.ros2.clauses import CLAUSES
from tests.clients.ros2.programs import ROOT, Shell, own_python
from tests.clients.ros2.robot import Robot
from tests.clients.ros2.views import View


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


def main():
    """Run all clauses and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    own = ROOT / ".venv/bin/rtask"
    parser.add_argument("--rtask", default=str(own) if own.exists() else "rtask",
                        help="command of RTASK, in its own Python")  # fmt: skip
    parser.add_argument("--node", default="ros2 run rtask_ros2 node", help="command of the node")
    parser.add_argument("--only", default="", help="regular expression of clauses to run")
    options = parser.parse_args()
    try:
        with_what = about()
    except ImportError as error:
        print(f"not run: no ROS 2 in this shell ({error}); source one")
        return 2
    python = str(Path(options.rtask.split()[0]).with_name("python"))
    shell, failed = Shell(options), 0
    try:
        view = shell.folder / "view.npz"
        made = subprocess.run(
            [python, "-m", "tests.rtask.ros2.view_file", str(view)], cwd=ROOT, check=True,
            env=own_python(), capture_output=True, text=True,
        )  # fmt: skip
        shell.contract, shell.view = made.stdout, View(view)
        shell.start_server()
        shell.robot = Robot()
        for words, check in CLAUSES:
            if options.only and not re.search(options.only, words):
                continue
            began = time.monotonic()
            try:
                note = check(shell) or ""
                state = "not run" if note.startswith("not run") else "ok"
            except Exception as error:  # noqa: BLE001 - the other clauses are run all the same
                failed, state = failed + 1, "FAILED"
                note = (
                    f"{error!r:.3000} at line {traceback.extract_tb(error.__traceback__)[1].lineno}"
                )
            note = f" ({note})" if note else ""
            print(f"{state:<8}{words}{note} [{time.monotonic() - began:.1f} s]", flush=True)
    finally:
        shell.close()
    print(f"{len(CLAUSES)} clauses, {failed} failed; run with {with_what}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
