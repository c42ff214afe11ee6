"""``rtask ros messages``: write the package of the operations' services and messages."""

from __future__ import annotations

from pathlib import Path

import click

from rtask.cli.options import json_option, print_json
from rtask.cli.ros.schema import engine_schema

__all__ = ["messages"]


@click.command()
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False))
@click.option(
    "--python",
    "as_python",
    is_flag=True,
    help="Also generate importable Python packages; needs ROS 1 on this machine.",
)
@json_option
def messages(folder: Path, as_python: bool, as_json: bool) -> None:
    """Write the package rtask_msgs into FOLDER, for catkin (ROS 1) and colcon (ROS 2).

    It is made from the declarations of the operations. FOLDER is the src of a workspace; build it
    there. The Python packages are for ROS 1 without a workspace: the last two lines that are
    printed make them known to a shell.
    """
    from rtask.interop.ros.find import use_ros
    from rtask.interop.ros.package import write_python, write_source

    schema = engine_schema()
    written, exports = [write_source(schema, folder)], list[str]()
    if as_python:
        python = folder.resolve() / "python"
        written += [python / name for name in write_python(schema, use_ros(), python)]
        exports = [
            f'export PYTHONPATH="$PYTHONPATH:{python}"',
            f'export ROS_PACKAGE_PATH="{folder.resolve()}:$ROS_PACKAGE_PATH"',
        ]
    if as_json:
        print_json({"packages": [str(package) for package in written], "exports": exports})
        return
    for line in (*written, *exports):
        click.echo(f"{line}")
