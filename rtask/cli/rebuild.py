"""``rtask rebuild``."""

from __future__ import annotations

from pathlib import Path

import click

from rtask.cli.options import data_option


@click.command()
@click.argument("what", type=click.Choice(["inferred", "all"]), default="inferred")
@data_option
def rebuild(what: str, data: Path) -> None:
    """Derive again what is derived: the graph is the truth, the rest follows from it."""
    import rtask

    with rtask.open(data) as kb:
        done = kb.rebuild(what)
    click.echo(f"inferred: +{done.added} -{done.removed}")
