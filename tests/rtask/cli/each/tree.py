"""All commands of ``rtask``, for tests of what each of them has to do."""

from __future__ import annotations

from collections.abc import Iterator

import click

from rtask.cli import cli

__all__ = ["walk_commands"]


def walk_commands(group: click.Group = cli, name: str = "") -> Iterator[tuple[str, click.Command]]:
    """Yield the commands below a group with their names, such as ``ontology list``."""
    context = click.Context(group)
    for child_name in group.list_commands(context):
        child = group.get_command(context, child_name)
        assert child is not None
        path = f"{name} {child_name}".strip()
        if isinstance(child, click.Group):
            yield from walk_commands(child, path)
        else:
            yield path, child
