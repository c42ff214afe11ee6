"""Options of ``rtask serve`` from a file: option, then environment, then ``rtask.toml``.

The file's members are the long options without their dashes, in a table ``[serve]``::

    [serve]
    host = "0.0.0.0"
    timeout = 60
    allow-service = ["https://dbpedia.org/sparql"]
    limit = ["patterns=256"]
"""

from __future__ import annotations

import dataclasses
import difflib
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import click

from endpoint.sparql.limits import Limits
from rtask.errors import UsageError

DEFAULT_FILE = Path("rtask.toml")
TABLE = "serve"


def read_settings(file: Path, known: Iterable[str]) -> dict[str, Any]:
    """Read the table of a file; keys as click names its parameters.

    Parameters
    ----------
    file
        TOML.
    known
        Names of the options, with dashes.

    Raises
    ------
    UsageError
        Not readable, or a name that is no option.
    """
    try:
        document = tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"{file}: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UsageError(f"{file}: {error}") from None
    table = document.get(TABLE, {})
    if not isinstance(table, dict):
        raise UsageError(f"{file}: [{TABLE}] is a table")
    names = set(known)
    for name in table:
        if name.replace("_", "-") not in names:
            near = difflib.get_close_matches(name.replace("_", "-"), names, n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise UsageError(f"{file}: [{TABLE}] has no setting {name!r}{hint}")
    return {name.replace("-", "_"): value for name, value in table.items()}


def use_file(context: click.Context, _: click.Parameter, file: Path | None) -> Path | None:
    """Let a file say what options and environment do not; a callback of ``--config``."""
    if file is None and DEFAULT_FILE.is_file():
        file = DEFAULT_FILE
    if file is not None:
        options = {
            option.removeprefix("--"): parameter.name
            for parameter in context.command.params
            for option in parameter.opts
            if option.startswith("--") and parameter.name != "config"
        }
        found = read_settings(file, options)
        names = {option.replace("-", "_"): name for option, name in options.items()}
        context.default_map = {str(names[key]): value for key, value in found.items()}
    return file


def limits_of(settings: Iterable[str]) -> Limits:
    """Return the limits that ``NAME=VALUE`` settings describe.

    Examples
    --------
    >>> limits_of(["patterns=256"]).patterns
    256

    Raises
    ------
    UsageError
        No such limit, or no number.
    """
    limits = Limits()
    names = [member.name for member in dataclasses.fields(Limits)]
    for setting in settings:
        name, _, value = setting.partition("=")
        if name not in names:
            raise UsageError(f"no limit {name!r}; there are {', '.join(names)}")
        if not value.isdigit() or int(value) == 0:
            raise UsageError(f"--limit {setting}: a whole number above 0 is wanted")
        limits = dataclasses.replace(limits, **{name: int(value)})
    return limits
