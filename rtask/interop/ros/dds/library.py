"""The C library of the wheel ``cyclonedds``, and that no other of its kind is in this process."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from rtask.errors import UsageError

__all__ = ["check_single_library", "loaded_libraries"]

_MAPS = Path("/proc/self/maps")
_LIBRARY = re.compile(r"(/\S*/libddsc[^/\s]*\.so\S*)$")


def loaded_libraries(maps: Iterable[str]) -> list[str]:
    """Return the files of Cyclone DDS among the lines of ``/proc/PID/maps``.

    Examples
    --------
    >>> loaded_libraries(["7f0 r-xp 00 08:01 42  /opt/ros/jazzy/lib/libddsc.so.0.10.2"])
    ['/opt/ros/jazzy/lib/libddsc.so.0.10.2']
    """
    matches = (_LIBRARY.search(line.rstrip()) for line in maps)
    return sorted({match[1] for match in matches if match})


def check_single_library() -> None:
    """Make sure that one Cyclone DDS is loaded: that of the wheel, which is imported already.

    With two, the functions of the one work on the structures of the other, which ends the process
    without a word; so it is where the library of an RMW of ROS 2 is preloaded.

    Raises
    ------
    UsageError
        There are several; ``details["libraries"]`` has their files.
    """
    try:
        libraries = loaded_libraries(_MAPS.read_text("utf-8", "replace").splitlines())
    except OSError:  # no Linux
        return
    if len(libraries) > 1:
        raise UsageError(
            f"two of Cyclone DDS are loaded into this process: {', '.join(libraries)}; start it "
            "without LD_PRELOAD and LD_LIBRARY_PATH: env -u LD_PRELOAD -u LD_LIBRARY_PATH rtask",
            libraries=libraries,
        )
