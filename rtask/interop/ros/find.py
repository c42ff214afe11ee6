"""Find ROS 1, and make it importable without changing the product's libraries.

The folder of ROS is appended to ``sys.path``: what both have, numpy first of all, stays the one of
this environment. ``PYTHONPATH`` would put it before them.
"""

from __future__ import annotations

import importlib
import importlib.util
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from rtask.errors import MissingExtraError

__all__ = ["INSTALL", "Installation", "find_ros", "use_ros"]

INSTALL = (
    "apt-get install python3-rospy python3-actionlib python3-tf2-ros python3-sensor-msgs "
    "python3-visualization-msgs python3-trajectory-msgs ros-trajectory-msgs ros-sensor-msgs"
)
_NEEDED = (
    "rospy", "genpy.generator", "actionlib", "tf2_ros", "sensor_msgs.msg", "visualization_msgs.msg",
    "trajectory_msgs.msg",
)  # fmt: skip
_DEBIAN = Path("/usr/lib/python3/dist-packages")
_SHARES = (Path("/usr/share"),)


@dataclass(frozen=True)
class Installation:
    """A ROS 1 whose Python packages this process can import.

    Parameters
    ----------
    packages
        Folder of the Python packages.
    version
        Version of rospy.
    shares
        Folders that hold a folder for each package, with its message definitions.
    """

    packages: Path
    version: str
    shares: tuple[Path, ...]

    def definitions(self, package: str) -> list[str]:
        """Return the folders with the ``.msg`` files of a package."""
        return [str(s / package / "msg") for s in self.shares if (s / package / "msg").is_dir()]


def find_ros() -> Path | None:
    """Return the folder that holds rospy: one that is importable already, else an installed one."""
    spec = importlib.util.find_spec("rospy")
    if spec is not None and spec.origin is not None:
        return Path(spec.origin).parent.parent
    places = [_DEBIAN, *sorted(Path("/opt/ros").glob("*/lib/python3/dist-packages"), reverse=True)]
    return next((place for place in places if (place / "rospy").is_dir()), None)


def use_ros() -> Installation:
    """Make rospy and the libraries beside it importable, and return where they are.

    Raises
    ------
    MissingExtraError
        There is no ROS 1 here, or it was built for another version of Python.
    """
    place = find_ros()
    if place is None:
        raise MissingExtraError(f"no rospy on this machine: {INSTALL}", library="rospy")
    if str(place) not in sys.path:
        sys.path.append(str(place))
    for name in _NEEDED:
        try:
            importlib.import_module(name)
        except ImportError as error:
            raise MissingExtraError(_why(place, name, error), library=name) from error
    version = str(getattr(importlib.import_module("rospy"), "__version__", "")) or _version(place)
    shares = (place.parent.parent.parent / "share",) if "/opt/ros" in str(place) else ()
    return Installation(place, version, (*shares, *_SHARES))


def _why(place: Path, name: str, error: ImportError) -> str:
    """Return why a part of an installed ROS cannot be imported, and what to do."""
    own = f"{sys.version_info.major}.{sys.version_info.minor}"
    theirs = _python_of(place)
    if theirs and theirs != own:
        return (
            f"ROS in {place} is for Python {theirs}, this is Python {own}: {name}: {error}; run "
            f"the node on a machine whose ROS is for Python {own} and set ROS_MASTER_URI there: "
            "nodes of different Pythons talk to each other"
        )
    return f"ROS in {place} lacks {name}: {error}; {INSTALL}"


def _python_of(place: Path) -> str:
    """Return the version of Python that an installation is for; empty if it cannot be told."""
    tags = {file.name.split(".cpython-")[1][:3] for file in place.glob("*/*.cpython-3*.so")}
    if len(tags) == 1:
        tag = tags.pop().rstrip("-")
        return f"{tag[0]}.{tag[1:]}"
    try:
        completed = subprocess.run(
            ["/usr/bin/python3", "-c", "import sys; print('%d.%d' % sys.version_info[:2])"],
            capture_output=True, text=True, timeout=10, check=False,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return completed.stdout.strip()


def _version(place: Path) -> str:
    eggs = sorted(place.glob("rospy-*.egg-info"))
    return eggs[0].name.removeprefix("rospy-").removesuffix(".egg-info") if eggs else ""
