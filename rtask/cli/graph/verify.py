"""``rtask verify``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from rtask.cli.options import data_option, json_option, open_to_read, print_json


@click.command()
@data_option
@click.option("--repair", is_flag=True, help="Put right what follows from the graph.")
@json_option
def verify(data: Path, repair: bool, as_json: bool) -> None:
    """Compare what is derived with what it is derived from, and blobs with their digests.

    Exit code 1 if there is an error; with --repair, if one is left.
    """
    import rtask

    if repair:
        with rtask.open(data, ontologies=False) as kb:
            findings = kb.verify(repair=True)
            left = kb.verify()
    else:
        with open_to_read(data) as kb:
            left = findings = kb.verify()
    if as_json:
        print_json([asdict(finding) for finding in findings])
    else:
        for finding in findings:
            click.echo(f"{finding.severity:6s} {finding.part:10s} {finding.detail}")
        if not findings:
            click.echo("all well")
    if any(finding.severity == "error" for finding in left):
        raise SystemExit(1)
