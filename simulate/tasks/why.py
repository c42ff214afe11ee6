"""``rtask simulate why``: the changes that ``rtask why`` proposes, tried on branches."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import click

from rtask.cli.connection import open_to_change
from rtask.cli.options import data_option, server_option
from rtask.cli.things import name_or_iri
from rtask.extras import missing_libraries, needs_extra
from simulate import options

__all__ = ["why"]

_MAX_TRIES = 20
_SERVICE = "rtask/FailureTrials"


@click.command()
@click.argument("subject", metavar="ATTEMPT|TASK|OBJECT")
@data_option
@server_option
@click.option(
    "-n", "--trials", "tries", type=click.IntRange(1, _MAX_TRIES), default=5, show_default=True,
    help="Draws of the cause, each of which every change meets.",
)  # fmt: skip
@options.seed("what is drawn for each try")
@click.option(
    "--budget", type=click.FloatRange(0, 300), default=30.0, show_default=True, metavar="S",
    help="Time after which no try begins, s; the rest is not tried.",
)  # fmt: skip
@click.option(
    "--keep-branch", "keep", metavar="NAME", default="",
    help="Keep the best change that held on a branch of this name.",
)  # fmt: skip
@options.json_flag("answer")
def why(
    subject: str, data: Path, server: str | None, tries: int, seed: int, budget: float,
    keep: str, as_json: bool,
) -> None:  # fmt: skip
    """Say why something failed, and try what would have mended it on branches of the graph.

    Each change is stated on a branch, planned there, and carried out by simulated robots in a lab
    in which the believed cause is real: so the answer holds if it is one of these causes. What a
    hand and a thing alone decide is tried in physics. The graph itself is never written. Exit code
    1 unless a change held in most tries.
    """
    fields = {"tries": tries, "seed": seed, "budget": budget}
    if server:
        answer = _asked(server, name_or_iri(subject, data, server), keep, fields)
    else:
        answer = _tried(data, name_or_iri(subject, data, server), keep, fields)
    if as_json:
        click.echo(json.dumps(answer))
    else:
        click.echo("\n".join(filter(None, (answer.get("why"), answer["text"]))))
    if not answer["holds"]:
        raise SystemExit(1)


def _asked(server: str, subject: str, keep: str, fields: dict[str, Any]) -> dict[str, Any]:
    """Return the answer of a server, which tries it beside its own work."""
    import rtask

    with rtask.connect(
        server, token=os.environ.get("RTASK_TOKEN"), timeout_s=fields["budget"] + 60.0
    ) as client:
        service = client.service(_SERVICE)
        if keep:
            return dict(service.keep_change(subject=subject, branch=keep, **fields))
        return dict(service.try_changes(subject=subject, **fields))


def _tried(data: Path, subject: str, keep: str, fields: dict[str, Any]) -> dict[str, Any]:
    """Return what comes of it in the folder, of which only branches are written."""
    if missing_libraries("simulate"):
        raise needs_extra("simulate", "trying a change")
    from simulate.tasks.trials import TrialOptions, require_keep, try_changes

    require_keep(keep)
    chosen = TrialOptions(fields["tries"], fields["seed"], fields["budget"], keep)
    with open_to_change(data) as graph:
        diagnosis, trial = try_changes(graph, subject, chosen)
    return {**diagnosis.to_dict(), "why": diagnosis.text, **trial.to_dict()}
