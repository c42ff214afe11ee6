"""The command that follows from a study."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rtask.kb.durability.settings import write_durably
from simulate import options

if TYPE_CHECKING:
    from simulate.study.declaration import Report, Study

__all__ = ["print_table", "publish", "study_command"]

Declare = Callable[..., "Study"]


def study_command(
    out: str,
    name: str | None = None,
    what: str = "figures",
    with_preset: bool = True,
    processes: int = 2,
) -> Callable[[Declare], click.Command]:
    """Return a decorator that makes a command of a function which returns a study.

    The function has the options of the study alone; how to run it (``--workers``, ``--out``,
    ``--resume``, ``--json``) is added here.

    Parameters
    ----------
    out
        The usual output folder.
    name
        Of the command; None = that of the function.
    what
        What ``--json`` prints.
    with_preset
        Whether the study has physics that may be faithful or fast; the function then takes
        ``preset``.
    processes
        How many, unless the user says otherwise: one where times are measured, or for one trial.
    """

    def decorate(declare: Declare) -> click.Command:
        @functools.wraps(declare)
        def command(workers: int, out: Path, resume: bool, as_json: bool, **given: Any) -> None:
            _carry_out(declare(**given), out, workers, resume, as_json)

        decorated: Callable[..., None] = command
        running = _running(out, what, with_preset, processes)
        for option in running:
            decorated = option(decorated)
        made = click.command(name)(decorated)
        # The help begins with what is studied; click puts the option that was added last first.
        made.params = made.params[len(running) :] + made.params[: len(running)]
        return made

    return decorate


def _running(out: str, what: str, with_preset: bool, processes: int) -> list[options.Option]:
    """Return the options of how to run a study, the last of its help first."""
    kept: list[options.Option] = [options.json_flag(what), options.resume, options.out(out)]
    return [*kept, *([options.preset] if with_preset else []), options.workers(processes)]


def _carry_out(study: Study, out: Path, workers: int, resume: bool, as_json: bool) -> None:
    """Run the trials that are missing, and publish the report."""
    from simulate.study.runner import run

    results = run(study, out, workers, resume)
    publish(study.describe(results, study.settings, out), out, as_json)


def publish(report: Report, folder: Path, as_json: bool) -> None:
    """Write a report into a folder, and print it as tables or as JSON."""
    folder.mkdir(parents=True, exist_ok=True)
    whole = {**report.figures, **report.more}
    write_durably(folder / report.file, json.dumps(whole, indent=1) + "\n")
    if as_json:
        click.echo(json.dumps(report.figures))
        return
    for table in report.tables:
        print_table(table.title, table.columns, table.rows)
    for line in report.lines:
        click.echo(line)
    files = ", ".join(str(folder / name) for name in (report.file, *report.pictures))
    click.echo(f"report  {files}")


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table of results."""
    from simulate.demo.console import Console

    Console().table(title, columns, rows)
