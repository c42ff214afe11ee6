"""The command ``rtask thesis``."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rtask.errors import RtaskError, UsageError
from simulate import options

if TYPE_CHECKING:
    from simulate.thesis.result import Setting
    from simulate.thesis.running import Outcome

__all__ = ["thesis"]

PrintTable = Callable[[str, Sequence[str], Sequence[Sequence[str]]], None]

_fast = click.option(
    "--fast", is_flag=True, help="Smaller sizes; each entry says what was made smaller."
)
_images = click.option(
    "--images",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    help="Photographs of 640 x 480 instead of simulated images, for Tables 2 and 3 of Gatto 2016.",
)
_workers = click.option(
    "--workers", default=1, show_default=True, type=click.IntRange(min=1),
    help="Processes for trials of studies; changes no result, but times where they share a core.",
)  # fmt: skip
_only = click.option(
    "--only",
    type=click.Choice(["gatto", "kehoe", "beyond"]),
    help="Of one thesis alone, or what neither has.",
)


@click.group(invoke_without_command=True)
@click.pass_context
def thesis(context: click.Context) -> None:
    """Run the tables and figures of the two theses, ours beside theirs.

    Without a command, list them.
    """
    if context.invoked_subcommand is None:
        context.invoke(list_entries)


@thesis.command("list")
@_only
@click.option("--limit", type=click.IntRange(min=1), help="List at most so many.")
@options.json_flag("entries")
def list_entries(only: str | None, limit: int | None, as_json: bool) -> None:
    """List every table, figure, algorithm, listing, experiment and promise, and its state.

    compared: a run prints our figures beside the thesis's; shown: a run shows ours, the thesis
    gives no figure; built: it does what the thesis tells in words; done differently, not
    applicable: the list says why. These three have no run.
    """
    from simulate.study.command import print_table
    from simulate.thesis.registry import ENTRIES

    every = [entry for entry in ENTRIES if only in (None, entry.thesis)]
    entries = every[:limit]
    if as_json:
        rows = [
            {"name": e.name, "section": e.section, "shows": e.shows, "state": e.state,
             "why": e.why or None}
            for e in entries
        ]  # fmt: skip
        click.echo(json.dumps({"entries": rows, "more": len(every) - len(entries)}))
        return
    print_table(
        "Two theses", ("name", "section", "shows", "state", "why"),
        [(e.name, e.section, e.shows, e.state, e.why) for e in entries],
    )  # fmt: skip
    if len(entries) < len(every):
        click.echo(f"{len(every) - len(entries)} more; --limit {len(every)} lists all")


@thesis.command()
@click.argument("name")
@_fast
@options.seed("every draw")
@_images
@click.option("--save-plots", type=options.folder(), help="Folder to write the pictures to.")
@_workers
@click.option("--out", type=options.folder(),
              help="Folder for finished trials, so that --resume goes on from there.")  # fmt: skip
@options.resume
@options.json_flag("figures")
def show(
    name: str,
    fast: bool,
    seed: int,
    images: Path | None,
    save_plots: Path | None,
    workers: int,
    out: Path | None,
    resume: bool,
    as_json: bool,
) -> None:
    """Run NAME and print ours beside the thesis's: kehoe-table-3.1, or kehoe-3.1 for all 3.1."""
    from simulate.study.command import print_table
    from simulate.thesis.registry import entries_named
    from simulate.thesis.running import machine, run_entries
    from simulate.thesis.words import machine_words

    if resume and out is None:
        raise UsageError("--resume goes on with what an earlier run kept in --out: name the folder")
    entries = entries_named(name)
    setting = _setting(fast, seed, images, out, resume, workers)
    with _results_alone():
        outcomes = run_entries(entries, setting, lambda outcome: None)
    shown: set[str] = set()
    for outcome in outcomes:
        if not as_json:
            _print(outcome, outcome.entry.run in shown, print_table)
        if save_plots is not None:
            _save(outcome, save_plots)
        shown.add(outcome.entry.run)
    if as_json:
        figures = {"machine": machine(), "seed": seed, "fast": fast,
                   "entries": [outcome.to_json() for outcome in outcomes]}  # fmt: skip
        click.echo(json.dumps(figures))
    elif any(outcome.result for outcome in outcomes):
        click.echo(f"seed {seed}, {'smaller' if fast else 'full'} sizes; {machine_words()}")
    _fail_for(outcomes)


@thesis.command("all")
@_fast
@_only
@options.seed("every draw")
@_images
@click.option("--out", default="rtask-theses", show_default=True, type=options.folder(),
              help="Folder for report.html and results.jsonl.")  # fmt: skip
@click.option("--markdown", type=options.folder(),
              help="Also write theses.md and images/theses/ to this folder.")  # fmt: skip
@_workers
@options.resume
@options.json_flag("where the report is, and each verdict")
def run_all(
    fast: bool,
    only: str | None,
    seed: int,
    images: Path | None,
    out: Path,
    markdown: Path | None,
    workers: int,
    resume: bool,
    as_json: bool,
) -> None:
    """Run all entries, and write a report with tables and pictures.

    With --fast within half an hour on two cores. results.jsonl has each entry as soon as it has
    run. No stored figure is reused, but for trials of the same run that --resume continues.
    """
    from simulate.thesis.page import to_html, write_markdown
    from simulate.thesis.registry import ENTRIES
    from simulate.thesis.running import machine, run_entries

    entries = [entry for entry in ENTRIES if only in (None, entry.thesis)]
    setting = _setting(fast, seed, images, out, resume, workers)
    out.mkdir(parents=True, exist_ok=True)
    with (out / "results.jsonl").open("w", encoding="utf-8") as journal, _results_alone():

        def note(outcome: Outcome) -> None:
            journal.write(json.dumps(outcome.to_json()) + "\n")
            journal.flush()
            click.echo(
                f"{outcome.entry.name}: {outcome.verdict} ({outcome.seconds:.1f} s)", err=True
            )

        outcomes = run_entries(entries, setting, note)
    where = machine()
    (out / "report.html").write_text(to_html(setting, where, outcomes), encoding="utf-8")
    written = None if markdown is None else write_markdown(markdown, setting, where, outcomes)
    if as_json:
        verdicts = {outcome.entry.name: outcome.verdict for outcome in outcomes}
        click.echo(json.dumps({"report": str(out / "report.html"), "verdicts": verdicts}))
    else:
        click.echo(f"report  {out / 'report.html'}")
        if written is not None:
            click.echo(f"written  {written}")
    _fail_for(outcomes)


@contextmanager
def _results_alone() -> Iterator[None]:
    """Send what Bullet and Mesa write to standard output to standard error."""
    out = os.dup(1)
    os.dup2(2, 1)
    try:
        yield
    finally:
        os.dup2(out, 1)
        os.close(out)


def _setting(
    fast: bool, seed: int, images: Path | None, out: Path | None, resume: bool, workers: int
) -> Setting:
    """Return how to run entries; refuse to mix two runs in one folder."""
    from simulate.thesis.result import Setting

    journals = None if out is None else out / "trials"
    if journals is not None and not resume and journals.exists():
        raise UsageError(f"{journals} holds a run; go on with --resume, or name another folder")
    return Setting(fast, seed, images, journals, resume, workers)


def _print(outcome: Outcome, is_shown: bool, print_table: PrintTable) -> None:
    from simulate.thesis.words import COLUMNS, cells, tolerances

    entry = outcome.entry
    where = f" (section {entry.section})" if entry.section else ""
    click.echo(f"{entry.title}{where}: {entry.shows}: {outcome.verdict}")
    if outcome.result is None:
        click.echo(outcome.error or entry.why)
        return
    if is_shown:
        click.echo("the same run as above")
        return
    rows = outcome.result.rows
    if rows:
        print_table(entry.name, COLUMNS, [cells(row, outcome) for row in rows])
    for note in (*outcome.result.notes, *tolerances(rows)):
        click.echo(f"- {note}")
    for row in rows:
        if row.verdict == "worse":
            click.echo(f"- worse: {row.what}: {row.because or 'not known why'}")
    if outcome.result.pictures:
        click.echo(f"{len(outcome.result.pictures)} pictures; --save-plots FOLDER writes them")
    click.echo(f"{outcome.seconds:.1f} s by the clock, {outcome.cpu_s:.1f} s of the processor")


def _save(outcome: Outcome, folder: Path) -> None:
    if outcome.result is None:
        return
    from simulate.thesis.charts import pictures_of

    folder.mkdir(parents=True, exist_ok=True)
    pictures = pictures_of(outcome.entry, outcome.result)
    for number, picture in enumerate(pictures.values(), 1):
        suffix = "png" if isinstance(picture, bytes) else "svg"
        data = picture if isinstance(picture, bytes) else picture.encode("utf-8")
        path = folder / f"{outcome.entry.name}-{number}.{suffix}"
        path.write_bytes(data)
        click.echo(f"picture  {path}")


def _fail_for(outcomes: list[Outcome]) -> None:
    broken = [outcome.entry.name for outcome in outcomes if outcome.error]
    if broken:
        raise RtaskError(f"{len(broken)} of {len(outcomes)} runs broke: {', '.join(broken)}")
