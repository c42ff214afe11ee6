"""``rtask restore``."""

from __future__ import annotations

from pathlib import Path

import click


@click.command()
@click.argument("source", type=click.Path(path_type=Path))
@click.argument("target", type=click.Path(path_type=Path))
def restore(source: Path, target: Path) -> None:
    """Make a knowledge base from a backup, in a new folder."""
    from rtask.kb.durability.backup import restore as restore_backup

    record = restore_backup(source, target)
    click.echo(f"{target}: commit {record['seq']} of {record['created']}")
