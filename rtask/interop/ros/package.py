"""The package ``rtask_msgs``: as source for catkin and rosidl, and as Python made by genpy.

Beside the services and messages of the declared operations it holds those written by hand in
``definitions``. Packages of other people that Debian lacks, such as moveit_msgs, are generated from
their field lines where they are not installed; their md5 sums are the published ones.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import importlib.metadata
import importlib.util
import io
import os
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path

from rtask.errors import UsageError
from rtask.interop.ros.convert import Make, make_message
from rtask.interop.ros.find import Installation
from rtask.interop.ros.schema import PACKAGE, Schema
from rtask.scratch import ScratchFolder

__all__ = ["definitions_of", "load_messages", "source_files", "write_python", "write_source"]

_DEFINITIONS = Path(__file__).parent / "definitions"
_OTHERS = (
    "control_msgs", "moveit_msgs", "object_recognition_msgs", "octomap_msgs", "shape_msgs",
)  # fmt: skip
_DEPENDS = (
    "actionlib_msgs", "geometry_msgs", "moveit_msgs", "sensor_msgs", "std_msgs", "trajectory_msgs",
)  # fmt: skip

_PACKAGE_XML = """<?xml version="1.0"?>
<package format="3">
  <name>{package}</name>
  <version>{version}</version>
  <description>Services, messages and actions of RTASK, made from its declarations.</description>
  <maintainer email="rtask@example.org">RTASK</maintainer>
  <license>Apache-2.0</license>

  <buildtool_depend condition="$ROS_VERSION == 1">catkin</buildtool_depend>
  <buildtool_depend condition="$ROS_VERSION == 2">ament_cmake</buildtool_depend>
  <buildtool_depend condition="$ROS_VERSION == 2">rosidl_default_generators</buildtool_depend>
  <build_depend condition="$ROS_VERSION == 1">message_generation</build_depend>
  <exec_depend condition="$ROS_VERSION == 1">message_runtime</exec_depend>
  <exec_depend condition="$ROS_VERSION == 2">rosidl_default_runtime</exec_depend>
  <depend condition="$ROS_VERSION == 2">action_msgs</depend>
{depends}
  <member_of_group condition="$ROS_VERSION == 2">rosidl_interface_packages</member_of_group>

  <export>
    <build_type condition="$ROS_VERSION == 2">ament_cmake</build_type>
  </export>
</package>
"""
_CMAKE = """cmake_minimum_required(VERSION 3.5)
project({package})

set(MESSAGES
{msg}
)
set(SERVICES
{srv}
)
set(ACTIONS
{action}
)

if("$ENV{{ROS_VERSION}}" STREQUAL "1")
  find_package(catkin REQUIRED COMPONENTS message_generation {depends})
  add_message_files(DIRECTORY msg FILES ${{MESSAGES}})
  add_service_files(DIRECTORY srv FILES ${{SERVICES}})
  add_action_files(DIRECTORY action FILES ${{ACTIONS}})
  generate_messages(DEPENDENCIES {depends})
  catkin_package(CATKIN_DEPENDS message_runtime {depends})
else()
  find_package(ament_cmake REQUIRED)
  find_package(rosidl_default_generators REQUIRED)
  foreach(dependency action_msgs {depends2})
    find_package(${{dependency}} REQUIRED)
  endforeach()
  list(TRANSFORM MESSAGES PREPEND "msg/")
  list(TRANSFORM SERVICES PREPEND "srv/")
  list(TRANSFORM ACTIONS PREPEND "action/")
  rosidl_generate_interfaces(${{PROJECT_NAME}} ${{MESSAGES}} ${{SERVICES}} ${{ACTIONS}}
    DEPENDENCIES action_msgs {depends2})
  ament_export_dependencies(rosidl_default_runtime)
  ament_package()
endif()
"""


def definitions_of(package: str) -> dict[str, str]:
    """Return the definitions written by hand: text by path, ``msg/Change.msg``."""
    folder = _DEFINITIONS / package
    return {
        file.relative_to(folder).as_posix(): file.read_text("utf-8")
        for file in sorted(folder.glob("*/*"))
    }


def source_files(schema: Schema) -> dict[str, str]:
    """Return the source package: text by path.

    Raises
    ------
    UsageError
        An operation and a definition written by hand have one name.
    """
    files = definitions_of(PACKAGE)
    made = {f"msg/{name}.msg": record.text for name, record in schema.records.items()}
    made |= {f"srv/{service.name}.srv": service.text for service in schema.services.values()}
    if both := files.keys() & made.keys():
        raise UsageError(f"{', '.join(sorted(both))}: made from a declaration and written by hand")
    files = dict(sorted({**files, **made}.items()))
    listed = {
        kind: "\n".join(f"  {Path(path).name}" for path in files if path.startswith(f"{kind}/"))
        for kind in ("msg", "srv", "action")
    }
    ros2 = " ".join(name for name in _DEPENDS if name != "actionlib_msgs")
    about = {"package": PACKAGE, "version": importlib.metadata.version("rtask-kg")}
    depends = "\n".join(
        f'  <depend condition="$ROS_VERSION == 1">{name}</depend>'
        if name == "actionlib_msgs"
        else f"  <depend>{name}</depend>"
        for name in _DEPENDS
    )
    return {
        "package.xml": _PACKAGE_XML.format(**about, depends=depends),
        "CMakeLists.txt": _CMAKE.format(
            **about, **listed, depends=" ".join(_DEPENDS), depends2=ros2
        ),
        **files,
    }


def write_source(schema: Schema, folder: Path) -> Path:
    """Write the source package into ``FOLDER/rtask_msgs`` and return that folder.

    A package that is there already is replaced.

    Raises
    ------
    UsageError
        There is something else, or it cannot be written.
    """
    target = folder / PACKAGE
    mine = target / "package.xml"
    if target.exists() and not (mine.is_file() and f"<name>{PACKAGE}</name>" in mine.read_text()):
        raise UsageError(f"{target} is there and is no package {PACKAGE}; name another folder")
    try:
        for kind in ("msg", "srv", "action"):
            shutil.rmtree(target / kind, ignore_errors=True)
            (target / kind).mkdir(parents=True)
        for path, text in source_files(schema).items():
            (target / path).write_text(text, "utf-8")
    except OSError as error:
        raise UsageError(f"{target}: {error.strerror}") from error
    return target


def load_messages(schema: Schema, ros: Installation) -> Make:
    """Make ``rtask_msgs`` and what is missing beside it importable; return what makes messages.

    The package is generated once for each set of definitions, into a cache of the user.
    """
    cache = _cache() / "ros" / _digest(schema, ros)
    if not cache.is_dir():
        cache.parent.mkdir(parents=True, exist_ok=True)
        with ScratchFolder("ros", cache.parent) as made:
            write_python(schema, ros, made / "packages")
            # Another process may have been faster, with the same result.
            with contextlib.suppress(OSError):
                (made / "packages").rename(cache)
    # First: an installed rtask_msgs may be that of another release.
    sys.path.insert(0, str(cache))
    importlib.invalidate_caches()
    return make_message


def write_python(schema: Schema, ros: Installation, folder: Path) -> list[str]:
    """Write the Python packages into a folder; return their names.

    Raises
    ------
    UsageError
        genpy refused a definition.
    """
    missing = _missing()
    texts = {PACKAGE: source_files(schema)}
    for name in _OTHERS:
        if name in missing or not ros.definitions(name):
            texts[name] = definitions_of(name)
    with ScratchFolder("ros") as work:
        search = {name: ros.definitions(name) for name in (*_DEPENDS, *_OTHERS)}
        for package, files in texts.items():
            search[package] = [str(work / package / "msg")]
            for path, text in _expanded(files).items():
                file = work / package / path
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_text(text, "utf-8")
        for package in (PACKAGE, *missing):
            _generate(package, work / package, search, folder / package)
    return [PACKAGE, *missing]


def _expanded(files: Mapping[str, str]) -> dict[str, str]:
    """Return messages and services, each action as its seven messages."""
    made: dict[str, str] = {}
    for path, text in files.items():
        name, kind = Path(path).stem, Path(path).suffix
        if kind in (".msg", ".srv"):
            made[path] = text
        if kind != ".action":
            continue
        goal, result, feedback = text.split("---\n")
        head = "Header header\nactionlib_msgs/Goal"
        made |= {
            f"msg/{name}Goal.msg": goal,
            f"msg/{name}Result.msg": result,
            f"msg/{name}Feedback.msg": feedback,
            f"msg/{name}ActionGoal.msg": f"{head}ID goal_id\n{name}Goal goal\n",
            f"msg/{name}ActionResult.msg": f"{head}Status status\n{name}Result result\n",
            f"msg/{name}ActionFeedback.msg": f"{head}Status status\n{name}Feedback feedback\n",
            f"msg/{name}Action.msg": f"{name}ActionGoal action_goal\n"
            f"{name}ActionResult action_result\n{name}ActionFeedback action_feedback\n",
        }
    return made


def _generate(package: str, source: Path, search: dict[str, list[str]], target: Path) -> None:
    from genpy import generate_initpy, generator

    output = io.StringIO()
    for kind, made_by in (("msg", generator.MsgGenerator()), ("srv", generator.SrvGenerator())):
        files = sorted(str(file) for file in (source / kind).glob(f"*.{kind}"))
        if not files:
            continue
        with contextlib.redirect_stderr(output), contextlib.redirect_stdout(output):
            failed = made_by.generate_messages(package, files, str(target / kind), search)
        if failed:
            raise UsageError(
                f"genpy made no {package}: {' '.join(output.getvalue().split())[:400]}"
            )
        generate_initpy.write_modules(str(target / kind))
    (target / "__init__.py").write_text("", "utf-8")


def _missing() -> list[str]:
    return [name for name in _OTHERS if importlib.util.find_spec(name) is None]


def _digest(schema: Schema, ros: Installation) -> str:
    """Return what the generated packages depend on as a name."""
    texts = [f"{path}\n{text}" for path, text in source_files(schema).items()]
    texts += [text for name in _missing() for text in definitions_of(name).values()]
    texts += [ros.version, *_missing()]
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()[:16]


def _cache() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "rtask"
