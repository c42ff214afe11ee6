"""``rtask backup``."""

from __future__ import annotations

from pathlib import Path

import click

from rtask.cli.options import data_option


@click.command()
@click.argument("target", type=click.Path(path_type=Path))
@data_option
def backup(target: Path, data: Path) -> None:
    """Copy a knowledge base to a new folder, which can be opened by itself."""
    import rtask

    with rtask.open(data, ontologies=False, reason=False) as kb:
        record = kb.backup(target)
    click.echo(f"{target}: commit {record['seq']}")
