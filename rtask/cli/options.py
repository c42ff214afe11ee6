"""Options that several commands share, and small things that all of them do the same way."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click
from click.core import ParameterSource

__all__ = [
    "agent_option",
    "announce_final",
    "announce_undo",
    "budget_option",
    "confirm_final",
    "data_option",
    "exit_if_empty",
    "exit_undecided",
    "json_option",
    "limit_option",
    "listing_option",
    "prefixes",
    "print_json",
    "read_text",
    "resource",
    "server_option",
    "shown_rows",
    "term",
    "yes_option",
]


Row = TypeVar("Row")
_LINES = 100

data_option = click.option(
    "--data",
    "-d",
    type=click.Path(path_type=Path),
    default=Path("rtask-data"),
    show_default=True,
    envvar="RTASK_DATA",
    show_envvar=True,
    help="Folder of the knowledge base.",
)
server_option = click.option(
    "--server",
    metavar="URL",
    envvar="RTASK_SERVER",
    show_envvar=True,
    help="Ask this server instead of a folder. Its token is read from RTASK_TOKEN.",
)
budget_option = click.option(
    "--budget",
    type=click.IntRange(min=1),
    metavar="N",
    help="Steps of the reasoner after which the answer is 'not decided'; a server has a limit.",
)
shapes_option = click.option(
    "--shapes",
    multiple=True,
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="File of SHACL shapes to check against as well; may be repeated.",
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON.")
yes_option = click.option(
    "--yes", "-y", is_flag=True, help="Do not ask before what cannot be undone."
)


def agent_option(help: str) -> Callable[..., Any]:
    """Return the option ``--agent``, which names a robot or a person."""
    return click.option("--agent", metavar="NAME", help=help)


def limit_option(default: int, help: str) -> Callable[..., Any]:
    """Return the option ``--limit``, which bounds the length of a listing."""
    return click.option(
        "--limit", "-n", type=click.IntRange(min=1), default=default, show_default=True, help=help
    )


listing_option = click.option(
    "--limit",
    "-n",
    type=click.IntRange(min=1),
    help="Largest number of lines; says how many are left out.  [default: 100; with --json all]",
)


def shown_rows(
    rows: Sequence[Row], limit: int | None, as_json: bool, *, newest: bool = False
) -> list[Row]:
    """Return what of a listing is printed, and say on standard error what is left out.

    Parameters
    ----------
    limit
        Value of `listing_option`.
    newest
        Whether the last rows are shown instead of the first.
    """
    bound = limit if limit is not None or as_json else _LINES
    if bound is None or len(rows) <= bound:
        return list(rows)
    which = "earlier" if newest else "more"
    click.echo(f"{len(rows) - bound} {which} left out: --limit {len(rows)} lists all", err=True)
    return list(rows[-bound:] if newest else rows[:bound])


def announce_undo(*command: str) -> None:
    """Print, on standard error, the command that undoes a change, for the same graph or server."""
    context = click.get_current_context()
    where: list[str] = []
    for name in ("data", "server"):
        value = context.params.get(name)
        if value and context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            where += [f"--{name}", str(value)]
    click.echo(f"undo: rtask {shlex.join([*command, *where])}", err=True)


def announce_final(remains: str) -> None:
    """Print, on standard error, that no command undoes a change, and what remains."""
    click.echo(f"this cannot be undone: {remains}", err=True)


def confirm_final(remains: str, yes: bool) -> None:
    """Announce a change that cannot be undone, before it is made, and ask at a terminal.

    Parameters
    ----------
    remains
        What will be gone, and what remains.
    yes
        Value of `yes_option`.
    """
    announce_final(remains)
    if not yes and sys.stdin.isatty():
        click.confirm("go on?", abort=True, err=True)


def exit_undecided(answer: object) -> None:
    """Exit with code 3 if an answer is None: neither yes nor no."""
    if answer is None:
        raise click.exceptions.Exit(3)


def exit_if_empty(results: object, message: str | None = None) -> None:
    """Exit with code 1 if nothing was found, as ``grep`` does.

    Parameters
    ----------
    message
        What is then printed to standard error.
    """
    if results:
        return
    if message:
        click.echo(message, err=True)
    raise click.exceptions.Exit(1)


def read_text(text: str | None, file: Path | None) -> str:
    """Return SPARQL text from the argument, a file, or standard input (``-``)."""
    from rtask.errors import UsageError

    if file is None and text is None:
        raise UsageError("give the text as an argument, --file FILE, or - for standard input")
    try:
        if file is not None:
            return file.read_text("utf-8")
        return sys.stdin.read() if text == "-" else str(text)
    except OSError as error:
        raise UsageError(f"{file or 'standard input'}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise UsageError(f"{file or 'standard input'} is not text in UTF-8: {error}") from error


def prefixes(base: str) -> dict[str, str]:
    """Return the prefixes that the command line predefines: the ontology's, and ``kb:``.

    Parameters
    ----------
    base
        What ``kb:`` stands for; empty where it is not known.
    """
    import ontology

    return {**ontology.PREFIXES, **({"kb": base} if base else {})}


def resource(text: str, base: str) -> str:
    """Return the IRI of a text in any form that a command prints; see `rtask.asking.terms`.

    >>> resource("kb:robot/panda-1", "urn:lab/"), resource("<urn:x>", "")
    ('urn:lab/robot/panda-1', 'urn:x')
    """
    from rtask.asking.terms import Reader

    return Reader(base).resource(text).value


def term(text: str, base: str) -> Any:
    """Return the RDF term of a text in any form that a command prints.

    >>> term("rt:Mug", "urn:lab/").value.rpartition("#")[2], term('"3"', "urn:lab/").value
    ('Mug', '3')
    """
    from rtask.asking.terms import Reader

    return Reader(base).term(text)


def print_json(value: Any) -> None:
    """Print a value as one JSON document."""
    click.echo(json.dumps(value, indent=2, ensure_ascii=False, default=str))
