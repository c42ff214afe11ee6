"""Installations without the extras: what works, and the messages of the rest."""

from __future__ import annotations

import ast
import importlib.metadata
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from rtask.extras import EXTRA_OF, missing_extra
from tests.architecture.imports import PACKAGES, ROOT, imports_of, source_files

_PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
# What a distribution is called where the name that is imported does not say.
_DISTRIBUTION = {
    "cv2": "opencv-python-headless",
    "faiss": "faiss-cpu",
    "sklearn": "scikit-learn",
    "pyhornedowl": "py-horned-owl",
    "pybullet_data": "pybullet",
    "pybullet_utils": "pybullet",
    "yaml": "pyyaml",
}

# Of a ROS that the user has; rtask/interop/ros/find.py says which packages of Debian bring ROS 1.
_OF_ROS = {
    "actionlib", "control_msgs", "genpy", "geometry_msgs", "lifecycle_msgs", "moveit_msgs",
    "rcl_interfaces", "rclpy", "rosgraph", "rosgraph_msgs", "rospy", "rtask_msgs",
    "sensor_msgs", "std_msgs", "tf2_msgs", "tf2_ros", "visualization_msgs",
}  # fmt: skip


def _names(requirements: list[str]) -> set[str]:
    """Return the distributions that requirements name, in lower case."""
    return {re.split(r"[\s<>=;\[!~]", requirement)[0].lower() for requirement in requirements}


def _distribution(library: str) -> str:
    return _DISTRIBUTION.get(library, library).lower().replace("_", "-")


def _imported_libraries() -> set[str]:
    """Return the top-level names of everything that the packages import from elsewhere."""
    found = set()
    for module in source_files():
        for node in imports_of(module):
            if isinstance(node, ast.Import):
                found |= {alias.name.partition(".")[0] for alias in node.names}
            elif node.module and not node.level:
                found.add(node.module.partition(".")[0])
    return found - set(PACKAGES) - sys.stdlib_module_names - _OF_ROS


def _without_extras(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run ``rtask`` where no library of an extra can be imported."""
    program = (
        f"import sys; sys.modules.update(dict.fromkeys({sorted(EXTRA_OF)}))\n"
        f"from rtask.cli import main; main({list(arguments)})"
    )
    return subprocess.run(
        [sys.executable, "-c", program], cwd=folder, capture_output=True, text=True, check=False
    )


@pytest.mark.slow
def test_every_library_that_is_imported_is_declared() -> None:
    base = _names(_PROJECT["dependencies"])
    for library in sorted(_imported_libraries()):
        declared = base
        if library in EXTRA_OF:
            declared = _names(_PROJECT["optional-dependencies"][EXTRA_OF[library]])
        assert _distribution(library) in declared, f"{library} is not declared in pyproject.toml"


def test_no_library_is_declared_for_nothing() -> None:
    used = {_distribution(library) for library in {*_imported_libraries(), *EXTRA_OF}}
    with_uvicorn = {"uvloop", "httptools"}  # uvicorn takes them up where it finds them
    assert not _names(_PROJECT["dependencies"]) - used - with_uvicorn


def test_every_extra_that_a_message_names_is_there() -> None:
    assert set(EXTRA_OF.values()) <= _PROJECT["optional-dependencies"].keys()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "extra"),
    [
        (["segment", "x.png"], "perception"),
        (["grasp", "push", "x.dxf"], "perception"),
        (["learn", "benchmark"], "perception"),
        (["simulate", "--robots", "1"], "simulate"),
        (["study", "hands"], "simulate"),
        (["thesis", "show", "kehoe-3.1"], "simulate"),
    ],
)
def test_a_missing_extra_is_one_line_that_names_it(
    tmp_path: Path, arguments: list[str], extra: str
) -> None:
    for argument in arguments:
        if "." in argument:
            (tmp_path / argument).write_bytes(b"")
    done = _without_extras(tmp_path, *arguments)
    command = arguments[0]
    wanted = f"rtask {command} needs the extra '{extra}': in the checkout, pip install '.[{extra}]'"
    assert done.stderr.splitlines() == [f"rtask: {wanted}"]
    assert done.returncode == 3


@pytest.mark.slow
def test_a_demo_without_its_extra_names_the_one_that_needs_none(tmp_path: Path) -> None:
    done = _without_extras(tmp_path, "demo")
    assert done.stderr.splitlines() == [
        "rtask: rtask demo needs the extra 'simulate': in the checkout, pip install '.[simulate]'; "
        "`rtask demo --recorded` shows a recorded run without it"
    ]
    assert done.returncode == 3


@pytest.mark.slow
def test_loading_and_asking_need_no_extra(tmp_path: Path) -> None:
    (tmp_path / "mug.ttl").write_text("<urn:mug> <urn:on> <urn:table> .")
    assert _without_extras(tmp_path, "load", "mug.ttl", "-d", "store").returncode == 0
    done = _without_extras(tmp_path, "query", "-d", "store", "ASK { <urn:mug> ?p ?o }")
    assert done.stdout == "yes\n"


def test_only_a_library_of_an_extra_is_taken_for_a_missing_extra() -> None:
    assert missing_extra(ModuleNotFoundError("no", name="elsewhere"), "this") is None
    # Installed, but a system library that it links against is missing: another remedy.
    assert missing_extra(ImportError("libGL.so.1: cannot open", name="cv2"), "this") is None


def test_everything_needed_for_the_tests_is_installed() -> None:
    for name in _names(_PROJECT["dependencies"]):
        assert importlib.metadata.version(name)
