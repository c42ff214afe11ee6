"""Options that several commands share, and small things that all of them do the same way."""

from __future__ import annotations

import json
import re
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlencode

import click
from click.core import ParameterSource

__all__ = [
    "RowsAsTheyCome",
    "agent_option",
    "announce_final",
    "announce_more",
    "announce_undo",
    "announce_why",
    "announce_why_stated",
    "budget_option",
    "confirm_final",
    "data_option",
    "exit_if_empty",
    "exit_undecided",
    "json_option",
    "limit_option",
    "listing",
    "listing_option",
    "prefixes",
    "print_json",
    "print_listing",
    "read_text",
    "resource",
    "server_option",
    "shown_parts",
    "shown_rows",
    "term",
    "yes_option",
]


Row = TypeVar("Row")
_LINES = 100
_ADDRESS = re.compile(r"[a-z+]+://")
_NOT_SHOWN = f"{__name__}.not_shown"


class _Folder(click.Path):
    """A folder; an address would lose a slash, and then be looked for on the disk."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, str) and _ADDRESS.match(value):
            self.fail(
                f"{value} is an address, and a folder is expected; commands that can ask a server "
                "take its address by --server",
                param,
                ctx,
            )
        return super().convert(value, param, ctx)


data_option = click.option(
    "--data",
    "-d",
    type=_Folder(path_type=Path),
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
branch_option = click.option(
    "--branch", metavar="NAME", help="In this branch of the folder; see `rtask branch`."
)
yes_option = click.option(
    "--yes", "-y", is_flag=True, help="Do not ask before what cannot be undone."
)


def agent_option(help: str) -> Callable[..., Any]:
    """Return the option ``--agent``, which names a robot or a person."""
    return click.option("--agent", metavar="NAME", help=help)


def _unbounded(context: click.Context, parameter: click.Parameter, value: int | None) -> int | None:
    return sys.maxsize if value == 0 else value


def limit_option(default: int, help: str) -> Callable[..., Any]:
    """Return the option ``--limit`` of what returns the best of something; 0 becomes `sys.maxsize`.

    What it cuts is announced by `announce_more`.
    """
    return click.option(
        "--limit", "-n", type=click.IntRange(min=0), default=default, show_default=True,
        callback=_unbounded, help=f"{help} 0 for all.",
    )  # fmt: skip


def listing(default: int = _LINES) -> Callable[..., Any]:
    """Return the option ``--limit`` of a listing, whose rows `shown_rows` bounds."""
    return click.option(
        "--limit",
        "-n",
        type=click.IntRange(min=0),
        callback=_unbounded,
        help="Largest number of entries, 0 for all; says how many more there are.  "
        f"[default: {default}; with --json all]",
    )


listing_option = listing()


def shown_rows(
    rows: Sequence[Row],
    limit: int | None,
    as_json: bool,
    *,
    default: int = _LINES,
    newest: bool = False,
    what: str = "",
) -> list[Row]:
    """Return what of a listing is printed, and announce how many rows are not.

    Parameters
    ----------
    limit, default
        Value of the option, and the number of rows where it is not given and the form is not JSON.
    newest
        Whether the last rows are shown instead of the first.
    what
        What the rows are, where a command prints several listings.
    """
    bound = limit if limit is not None else sys.maxsize if as_json else default
    if limit not in (None, sys.maxsize) or len(rows) > bound:
        announce_more(max(0, len(rows) - bound), "earlier" if newest else "more", what)
    return list(rows[max(0, len(rows) - bound) :] if newest else rows[:bound])


def print_listing(
    rows: Sequence[Row],
    limit: int | None,
    as_json: bool,
    line: Callable[[Row], str],
    nothing: str | None = None,
    *,
    to_data: Callable[[Row], Any] = lambda row: row,
    default: int = _LINES,
) -> None:
    """Print a listing, and exit with code 1 if it is empty.

    Parameters
    ----------
    limit, default
        See :func:`shown_rows`.
    line
        Returns a row as text.
    nothing
        Printed to standard error if there is no row.
    to_data
        Returns a row as JSON data.
    """
    shown = shown_rows(rows, limit, as_json, default=default)
    if as_json:
        print_json([to_data(row) for row in shown])
    else:
        for row in shown:
            click.echo(line(row))
    exit_if_empty(shown, nothing)


class RowsAsTheyCome:
    """A listing whose rows are printed while they are made; as JSON, a list.

    Parameters
    ----------
    limit
        Value of the option ``--limit``.
    as_json
        Whether rows are printed as JSON.
    """

    def __init__(self, limit: int | None, as_json: bool) -> None:
        self._bound = limit if limit is not None else sys.maxsize if as_json else _LINES
        self._announces = limit not in (None, sys.maxsize)
        self._as_json, self._rows = as_json, 0

    def show(self, row: Any, line: str) -> None:
        """Print a row, as JSON or as a line, unless enough are printed."""
        self._rows += 1
        if self._rows > self._bound:
            return
        if self._as_json:
            first = '{"rows": [' if self._announces else "["
            line = f"{first if self._rows == 1 else ','}\n{json.dumps(row, ensure_ascii=False)}"
        click.echo(line, nl=not self._as_json)
        sys.stdout.flush()

    def end(self) -> None:
        """End the listing, and announce how many rows were not printed."""
        more = max(0, self._rows - self._bound)
        if not self._as_json:
            if self._announces or more:
                announce_more(more)
            return
        start = "" if min(self._rows, self._bound) else "["
        if self._announces:
            start = start and '{"rows": ['
            click.echo(f'{start}\n], "not_shown": {more}}}')
        else:
            click.echo(f"{start}\n]")


def shown_parts(
    document: Mapping[str, Any], limit: int | None, as_json: bool, *, default: int = _LINES
) -> dict[str, Any]:
    """Return a document with each listing in it as `shown_rows` bounds it, under its own name."""
    return {
        name: shown_rows(value, limit, as_json, default=default, what=name)
        if isinstance(value, list)
        else value
        for name, value in document.items()
    }


def announce_more(number: int, which: str = "more", what: str = "") -> None:
    """Say how many rows are not shown: on standard error, or in what `print_json` prints.

    JSON that ``--limit`` bounds is an object with the member ``not_shown``, even where that is 0:
    its form depends on what was asked, not on how much there is.
    """
    context = click.get_current_context()
    context.meta[_NOT_SHOWN] = context.meta.get(_NOT_SHOWN, 0) + number
    if number and not context.params.get("as_json"):
        words = f"{number} {which} {what}".rstrip()
        click.echo(f"{words}; --limit 0 for all", err=True)


def print_change(done: Mapping[str, Any], as_json: bool, changed: str, unchanged: str) -> None:
    """Print what became of a change: as JSON, or in words with the command that undoes it."""
    if as_json:
        print_json(dict(done))
    elif done["commit"]:
        click.echo(changed)
        announce_undo("undo", done["commit"])
    else:
        click.echo(unchanged)


def announce_undo(*command: str) -> None:
    """Print, on standard error, the command that undoes a change, for the same graph or server."""
    click.echo(f"undo: rtask {shlex.join([*command, *_same_graph()])}", err=True)


def announce_why(*command: str) -> None:
    """Print, on standard error, the command that shows what the numbers of an answer rest on."""
    click.echo(f"why: rtask {shlex.join([*command, *_same_graph()])}", err=True)


def announce_why_computed(rests_on: str) -> None:
    """Print, on standard error, what numbers rest on that were computed here and stored nowhere."""
    click.echo(f"why: {rests_on}", err=True)


def announce_why_stated(iri: str) -> None:
    """Print, on standard error, where to see who stated what about something, and when.

    For a folder that is a command; a server has a page instead of its journal.
    """
    server = click.get_current_context().params.get("server")
    if server:
        click.echo(f"why: {server.rstrip('/')}/resource?{urlencode({'iri': iri})}", err=True)
    else:
        announce_why("history", iri)


def _same_graph() -> list[str]:
    """Return the options that name the folder or server of this call; none where none was given."""
    context = click.get_current_context()
    where: list[str] = []
    for name in ("data", "server"):
        value = context.params.get(name)
        if value and context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            where += [f"--{name}", str(value)]
    return where


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
    """Print a value as one JSON document; what `announce_more` counted is its ``not_shown``."""
    context = click.get_current_context(silent=True)
    number = None if context is None else context.meta.get(_NOT_SHOWN)
    if number is not None:
        value = {**(value if isinstance(value, dict) else {"rows": value}), "not_shown": number}
    click.echo(json.dumps(value, indent=2, ensure_ascii=False, default=str))
