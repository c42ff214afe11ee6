"""``rtask simulate why``: the change that ``rtask why`` proposes, tried in physics."""

from __future__ import annotations

import json
from pathlib import Path

import click

from rtask.cli.connection import open_graph
from rtask.cli.options import data_option, server_option
from rtask.cli.things import name_or_iri
from rtask.extras import missing_libraries, needs_extra
from rtask.tasks.bounds import Bounds
from rtask.tasks.diagnosis import diagnose
from rtask.tasks.diagnosis.reading import read_failure
from simulate import options

__all__ = ["why"]

_MAX_TRIES = 50


@click.command()
@click.argument("subject", metavar="ATTEMPT|TASK|OBJECT")
@data_option
@server_option
@click.option(
    "-n", "--trials", "tries", type=click.IntRange(1, _MAX_TRIES), default=5, show_default=True,
    help="How often the change is tried.",
)  # fmt: skip
@options.seed("what is drawn for each try")
@options.json_flag("answer")
def why(subject: str, data: Path, server: str | None, tries: int, seed: int, as_json: bool) -> None:
    """Say why something failed, and try in physics what would have mended it.

    Another grasp or another hand is tried by a hand without an arm, beside the grasp that failed,
    at a thing in which hides what the graph believes to be the cause. So the answer holds if that
    is the cause. The graph is opened for reading alone, and nothing is stored. Exit code 1 unless
    the failure is reproduced and the change holds in most tries.
    """
    if missing_libraries("simulate"):
        raise needs_extra("simulate", "trying a change")
    from simulate.tasks.failure_trial import try_change

    subject = name_or_iri(subject, data, server)
    with open_graph(data, server) as graph:
        diagnosis = diagnose(read_failure(Bounds(graph).select, subject))
    # The graph is closed before anything is tried: physics cannot write to what is not open.
    trial = try_change(diagnosis, tries, seed)
    if as_json:
        click.echo(json.dumps({**diagnosis.to_dict(), "trial": trial.to_dict()}))
    else:
        click.echo(f"{diagnosis.text}\n{trial.text}")
    if not trial.agrees:
        raise SystemExit(1)
