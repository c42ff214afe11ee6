"""The ROS 2 that a shell has sourced, as far as its variables and files tell: no ROS is needed."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

from rtask.cli.doctor import Finding
from rtask.cli.ros2.package import NAME, PROVIDED
from rtask.interop.ros.package import source_files
from rtask.interop.ros.schema import PACKAGE, Schema

__all__ = ["Sourced", "examine_environment", "examine_packages"]

_RANGES = ("SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT")
_BUILD = "rtask ros messages ~/ws/src; cd ~/ws && colcon build && source install/setup.bash"
_PROFILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE", "CYCLONEDDS_URI")
_MAX_NAMED = 5


class Sourced:
    """The prefixes of a sourced ROS 2.

    Parameters
    ----------
    variables
        Of the shell.
    """

    def __init__(self, variables: Mapping[str, str] | None = None) -> None:
        self.variables = os.environ if variables is None else variables
        self.distribution = self.variables.get("ROS_DISTRO", "")
        paths = self.variables.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
        self.prefixes = [Path(path) for path in paths if path]

    def __bool__(self) -> bool:
        return bool(self.prefixes)

    def share(self, package: str) -> Path | None:
        """Return the folder of a package's own files, or None if it is not built."""
        folders = (prefix / "share" / package for prefix in self.prefixes)
        return next((folder for folder in folders if folder.is_dir()), None)

    def library(self, name: str) -> Path | None:
        """Return a shared library of one of the prefixes, or None."""
        files = (prefix / "lib" / f"lib{name}.so" for prefix in self.prefixes)
        return next((file for file in files if file.exists()), None)

    def python_versions(self) -> list[str]:
        """Return the versions of Python that have rclpy in a prefix, ``3.12``."""
        versions = [
            file.parents[1].name.removeprefix("python")
            for prefix in self.prefixes
            for file in prefix.glob("lib/python3.*/*-packages/rclpy")
        ]
        return sorted(set(versions))


def examine_environment(ros: Sourced, domain: int) -> Iterator[Finding]:
    """Look at the distribution, the RMW, the domain and the range of the discovery."""
    yield _distribution(ros)
    rmw = ros.variables.get("RMW_IMPLEMENTATION", "")
    if rmw and ros and ros.library(rmw) is None and not _is_preloaded(ros, rmw):
        package = f"ros-{ros.distribution or '$ROS_DISTRO'}-{rmw.replace('_', '-')}"
        yield Finding(
            "rmw", "broken", f"RMW_IMPLEMENTATION is {rmw}, which is not installed",
            f"apt-get install {package}, or unset RMW_IMPLEMENTATION",
        )  # fmt: skip
    # Above 101 the ports of a domain lie where Linux lends them out (ROS 2, ROS_DOMAIN_ID).
    if domain > 101:
        yield Finding("domain", "note", f"{domain}: its ports may be taken", "use 0 to 101")
    else:
        yield Finding("domain", "ok", f"{domain}")
    yield _discovery(ros.variables)
    yield from _files(ros.variables)


def _is_preloaded(ros: Sourced, rmw: str) -> bool:
    return f"lib{rmw}.so" in ros.variables.get("LD_PRELOAD", "")


def _distribution(ros: Sourced) -> Finding:
    if ros.variables.get("ROS_VERSION") == "1":
        return Finding(
            "distribution", "broken", f"ROS 1 is sourced: {ros.distribution}",
            "use a new shell, and source a ROS 2 in it; for ROS 1 there is rtask ros doctor",
        )  # fmt: skip
    if ros:
        return Finding("distribution", "ok", f"{ros.distribution or 'unnamed'} is sourced")
    installed = sorted(Path("/opt/ros").glob("*/local_setup.bash"))
    setup = installed[-1].with_name("setup.bash") if installed else "/opt/ros/jazzy/setup.bash"
    return Finding(
        "distribution", "note", "no ROS 2 is sourced; only rtask ros2 dds works without",
        f"source {setup}",
    )  # fmt: skip


def _discovery(variables: Mapping[str, str]) -> Finding:
    if variables.get("ROS_LOCALHOST_ONLY") == "1":
        return Finding(
            "discovery", "note", "ROS_LOCALHOST_ONLY=1: other machines are not seen",
            "unset ROS_LOCALHOST_ONLY",
        )  # fmt: skip
    name = "ROS_AUTOMATIC_DISCOVERY_RANGE"
    given, peers = variables.get(name, ""), variables.get("ROS_STATIC_PEERS", "")
    shown = f"{given or 'SUBNET'}{f', and the peers {peers}' if peers else ''}"
    if given and given not in _RANGES:
        words = f"{name} is {given!r}; expected one of {', '.join(_RANGES)}"
        return Finding("discovery", "broken", words, f"unset {name}")
    if given == "OFF":
        return Finding("discovery", "broken", "OFF: no other node is seen", f"unset {name}")
    if given == "LOCALHOST" and not peers:
        words = "LOCALHOST: nodes of other machines are not seen"
        return Finding("discovery", "note", words, f"unset {name}, or set ROS_STATIC_PEERS")
    return Finding("discovery", "ok", shown)


def _files(variables: Mapping[str, str]) -> Iterator[Finding]:
    """Look whether the files that set the network of the DDS are there."""
    for name in _PROFILES:
        given = variables.get(name, "").removeprefix("file://")
        if given and not given.lstrip().startswith("<") and not Path(given).is_file():
            yield Finding(
                "profile", "broken", f"{name} names {given}: no such file", f"unset {name}"
            )


def examine_packages(ros: Sourced, schema: Schema) -> Iterator[Finding]:
    """Look whether the packages of the node are built, and of which definitions."""
    missing = [name for name in PROVIDED if name != PACKAGE and ros.share(name) is None]
    if missing:
        names = " ".join(f"ros-$ROS_DISTRO-{name.replace('_', '-')}" for name in missing)
        yield Finding(
            "packages", "broken", f"not there: {', '.join(missing)}", f"apt-get install {names}"
        )
    yield _messages(ros.share(PACKAGE), schema)
    if ros.share(NAME) is None:
        yield Finding(
            NAME, "note", "not built: `ros2 run rtask_ros2 node` does not work",
            f"rtask ros2 package ~/ws/src; {_BUILD.partition('; ')[2]}",
        )  # fmt: skip
        return
    yield _node_package(ros, schema)


def _messages(folder: Path | None, schema: Schema) -> Finding:
    """Compare the built ``rtask_msgs`` with the definitions of this release, and the hashes."""
    if folder is None:
        return Finding(PACKAGE, "broken", "not built, or its workspace is not sourced", _BUILD)
    definitions = {
        path: text
        for path, text in source_files(schema).items()
        if path.partition("/")[0] in ("msg", "srv", "action")
    }
    wrong = [
        path
        for path, text in definitions.items()
        if not (folder / path).is_file() or (folder / path).read_text("utf-8") != text
    ]
    hashes = _built_hashes(folder)
    if hashes and not wrong:
        from rtask.interop.ros.dds.types import RosTypes

        own = RosTypes(schema).hashes()
        wrong = [name for name, value in hashes.items() if own.get(name) != value]
    if wrong:
        more = f" and {len(wrong) - _MAX_NAMED} more" if len(wrong) > _MAX_NAMED else ""
        words = f"built by another release: {', '.join(wrong[:_MAX_NAMED])}{more} differ"
        return Finding(PACKAGE, "broken", f"{words}; in {folder}", _BUILD)
    compared = f"{len(hashes)} hashes agree" if hashes else "this ROS 2 has no hashes to compare"
    return Finding(PACKAGE, "ok", f"{len(definitions)} definitions agree, {compared}")


def _built_hashes(folder: Path) -> dict[str, str]:
    """Return the hash of each type of a built package; Humble's tools make none."""
    hashes: dict[str, str] = {}
    for file in sorted(folder.glob("*/*.json")):
        for entry in json.loads(file.read_text("utf-8")).get("type_hashes", ()):
            if entry["type_name"].startswith(f"{folder.name}/"):
                hashes[entry["type_name"]] = entry["hash_string"]
    return hashes


def _node_package(ros: Sourced, schema: Schema) -> Finding:
    from rtask.client.base import RULES
    from rtask.ros2.contract import Contract

    pattern = f"lib/python3.*/*-packages/{NAME}/ros2/contract.json"
    files = [file for prefix in ros.prefixes for file in sorted(prefix.glob(pattern))]
    try:
        is_same = bool(files) and Contract.read(files[0]) == Contract(schema, RULES)
    except (ValueError, KeyError, TypeError):
        is_same = False
    if files and not is_same:
        return Finding(
            NAME, "broken", f"made by another release: {files[0]}",
            f"rtask ros2 package ~/ws/src; {_BUILD.partition('; ')[2]}",
        )  # fmt: skip
    return Finding(NAME, "ok", "built; it has the operations of this release")


def python_names(ros: Sourced) -> list[str]:
    """Return the Pythons that may have this ROS 2, the likeliest first."""
    names = [f"python{version}" for version in ros.python_versions()]
    names += [str(prefix / "bin/python3") for prefix in ros.prefixes]
    names = ["python3", *names, "/usr/bin/python3"]
    return [name for name in dict.fromkeys(names) if re.search(r"python3", name)]
