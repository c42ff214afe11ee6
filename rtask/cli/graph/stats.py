"""``rtask stats``."""

from __future__ import annotations

from pathlib import Path

import click

from rtask.cli.options import data_option, json_option, print_json


@click.command()
@data_option
@json_option
def stats(data: Path, as_json: bool) -> None:
    """Count what a knowledge base holds."""
    import rtask

    with rtask.open(data, mode="r") as kb:
        found = kb.stats()
    if as_json:
        print_json(found)
        return
    graphs = found.pop("graphs")
    for name, value in found.items():
        click.echo(f"{name:12s} {value}")
    for name, size in graphs.items():
        click.echo(f"{size:12d} {name}")
