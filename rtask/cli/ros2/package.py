"""``rtask ros2 package``: write the distribution ``rtask-ros2``.

It holds ``rtask.ros2`` and whatever that imports of ``rtask``, under the name ``rtask_ros2``: one
source for both distributions, and no import of the other.
"""

from __future__ import annotations

import ast
import importlib.metadata
import json
import re
import shutil
from pathlib import Path

import click

from rtask.cli.options import json_option, print_json
from rtask.errors import UsageError

__all__ = ["DEPENDENCIES", "PROVIDED", "package", "source_modules", "write_package"]

NAME = "rtask_ros2"
DEPENDENCIES = ("numpy", "websockets>=15")
PROVIDED = (
    "moveit_msgs", "rcl_interfaces", "rclpy", "rtask_msgs", "sensor_msgs", "std_msgs",
    "tf2_msgs", "visualization_msgs",
)  # fmt: skip
"""Packages of the ROS 2 environment that the node imports, or makes messages of."""
_ROOT = Path(__file__).parents[2]
_START = "rtask.ros2.main"
_IMPORT = re.compile(r"^(\s*(?:from|import) )rtask(?=[.\s])", re.MULTILINE)
_SETUP_PY = """from setuptools import find_packages, setup

setup(
    name="{name}",
    version="{version}",
    packages=find_packages(),
    package_data={{"{name}.ros2": ["contract.json"]}},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/{name}"]),
        ("share/{name}", ["package.xml"]),
        ("lib/{name}", ["scripts/node"]),
    ],
    install_requires={dependencies!r},
    python_requires=">=3.10",
    zip_safe=True,
    maintainer="RTASK",
    maintainer_email="rtask@example.org",
    description="The node of RTASK for ROS 2.",
    license="Apache-2.0",
    entry_points={{"console_scripts": ["rtask-ros2-node = {name}.ros2.main:main"]}},
)
"""
_SETUP_CFG = "[develop]\nscript_dir=$base/lib/{name}\n"
_SCRIPT = (
    "#!/usr/bin/env python3\nimport sys\n\nfrom {name}.ros2.main import main\n\nsys.exit(main())\n"
)
_XML = """<?xml version="1.0"?>
<package format="3">
  <name>{name}</name>
  <version>{version}</version>
  <description>The node of RTASK for ROS 2.</description>
  <maintainer email="rtask@example.org">RTASK</maintainer>
  <license>Apache-2.0</license>

  <exec_depend>python3-numpy</exec_depend>
{depends}

  <export>
    <build_type>ament_python</build_type>
  </export>
</package>
"""


@click.command()
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False))
@json_option
def package(folder: Path, as_json: bool) -> None:
    """Write the package rtask_ros2, the node for ROS 2, into FOLDER.

    FOLDER is the src of a workspace; build it there with colcon, beside the package of `rtask ros
    messages`. Or `pip install FOLDER/rtask_ros2` into the Python of ROS 2. The node needs nothing
    else of this installation.
    """
    written = write_package(folder)
    if as_json:
        print_json({"package": str(written), "modules": list(source_modules())})
    else:
        click.echo(f"{written}")


def source_modules() -> dict[str, Path]:
    """Return the file of each module of ``rtask`` that the node imports, itself included."""
    files: dict[str, Path] = {}
    todo = [_START]
    while todo:
        module = todo.pop()
        file = _file_of(module)
        if file is None or module in files:
            continue
        files[module] = file
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if isinstance(node, ast.Import):
                todo += [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                todo += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return dict(sorted(files.items()))


def write_package(folder: Path) -> Path:
    """Write the source package into ``FOLDER/rtask_ros2`` and return that folder.

    A package that is there already is replaced.

    Raises
    ------
    UsageError
        There is something else, or it cannot be written.
    """
    target = folder / NAME
    mine = target / "package.xml"
    if target.exists() and not (mine.is_file() and f"<name>{NAME}</name>" in mine.read_text()):
        raise UsageError(f"{target} is there and is no package {NAME}; name another folder")
    try:
        shutil.rmtree(target, ignore_errors=True)
        for path, text in _texts().items():
            file = target / path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, "utf-8")
        (target / "scripts/node").chmod(0o755)
    except OSError as error:
        raise UsageError(f"{target}: {error.strerror}") from error
    return target


def _texts() -> dict[str, str]:
    """Return the text of each file of the package by its path."""
    from rtask.cli.ros.schema import engine_schema
    from rtask.client.base import RULES
    from rtask.ros2.contract import Contract

    about = {"name": NAME, "version": importlib.metadata.version("rtask-kg")}
    depends = "\n".join(f"  <exec_depend>{name}</exec_depend>" for name in PROVIDED)
    contract = Contract(engine_schema(), RULES)
    texts = {
        "package.xml": _XML.format(**about, depends=depends),
        "setup.py": _SETUP_PY.format(**about, dependencies=list(DEPENDENCIES)),
        "setup.cfg": _SETUP_CFG.format(**about),
        f"resource/{NAME}": "",
        "scripts/node": _SCRIPT.format(**about),
        f"{NAME}/ros2/contract.json": json.dumps(contract.as_json(), indent=1) + "\n",
    }
    for module, file in source_modules().items():
        path = Path(NAME, *module.split(".")[1:]).with_suffix(".py")
        texts[path.as_posix()] = _IMPORT.sub(rf"\g<1>{NAME}", file.read_text("utf-8"))
        for folder in path.parents[:-1]:
            # What the packages of the other distribution import at their start is not needed here.
            texts.setdefault(f"{folder.as_posix()}/__init__.py", "")
    return texts


def _file_of(module: str) -> Path | None:
    """Return the file of a module of this distribution that is no package."""
    parts = module.split(".")
    file = _ROOT.joinpath(*parts[1:]).with_suffix(".py")
    return file if parts[0] == "rtask" and len(parts) > 1 and file.is_file() else None
