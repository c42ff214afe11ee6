"""The reference page of the command line, written from the help of the commands for the site."""

from __future__ import annotations

from collections.abc import Iterator

import click

from rtask.cli import cli

__all__ = ["reference"]

_WIDTH = 96
_HEAD = """# Command line

Generated from the help of the commands; `rtask COMMAND --help` shows the same.

**Errors** are one line on standard error; `rtask --debug COMMAND` shows the traceback.
**Exit codes**: 0 done; 1 the answer is no, or nothing was found; 2 the call is wrong; 3 failed; 130
interrupted.

**Where the graph is**: `--data FOLDER` (or `RTASK_DATA`), by default `rtask-data` in the working
directory. Commands with `--server URL` (or `RTASK_SERVER`) ask a running server instead, with the
token in `RTASK_TOKEN`. The other commands work on the files themselves.

**Output**: results go to standard output, progress and remarks to standard error, so that
`rtask COMMAND --json | jq` works.

**Completion** of commands and options in the shell:

```sh no-run
eval "$(_RTASK_COMPLETE=bash_source rtask)"     # in ~/.bashrc
eval "$(_RTASK_COMPLETE=zsh_source rtask)"      # in ~/.zshrc
_RTASK_COMPLETE=fish_source rtask | source      # in ~/.config/fish/config.fish
```
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
