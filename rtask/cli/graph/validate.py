"""``rtask validate``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from rtask.cli.options import data_option, json_option, open_to_read, print_json


@click.command()
@data_option
@json_option
def validate(data: Path, as_json: bool) -> None:
    """Hold everything against the SHACL shapes that come with the ontology.

    Exit code 1 if there is a violation; warnings are listed only.
    """
    with open_to_read(data) as kb:
        found = kb.validate()
    if as_json:
        print_json([asdict(one) for one in found])
    else:
        for one in found:
            where = f" (in {one.graph})" if one.graph else ""
            click.echo(f"{one.severity:10s} {one}{where}")
        if not found:
            click.echo("all well")
    if any(one.severity == "Violation" for one in found):
        raise SystemExit(1)
