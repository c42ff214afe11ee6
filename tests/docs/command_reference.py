"""The reference of the command line, written from what the commands say of themselves.

``make docs`` renews the page.
"""

from __future__ import annotations

from collections.abc import Iterator

import click

from rtask.cli import cli

__all__ = ["reference"]

_WIDTH = 96
_HEAD = """# Command line

Written from the commands' own help; `rtask COMMAND --help` shows the same.
Errors are one line on standard error. Exit codes: 0 done, 1 the data or the state forbid it,
2 the call is wrong, 130 interrupted. `rtask --debug COMMAND` shows the traceback.
"""


def reference() -> str:
    """Return the page."""
    return "\n".join([_HEAD, *_sections(cli, "rtask", None)]).rstrip() + "\n"


def _sections(command: click.Command, name: str, parent: click.Context | None) -> Iterator[str]:
    context = click.Context(
        command,
        info_name=name.rpartition(" ")[2],
        parent=parent,
        terminal_width=_WIDTH,
        help_option_names=["-h", "--help"],
    )
    yield f"## {name}\n\n```text\n{command.get_help(context)}\n```\n"
    if isinstance(command, click.Group):
        for child_name in command.list_commands(context):
            child = command.get_command(context, child_name)
            if child is not None and not child.hidden:
                yield from _sections(child, f"{name} {child_name}", context)


if __name__ == "__main__":
    click.echo(reference(), nl=False)
