"""``rtask update``."""

from __future__ import annotations

from pathlib import Path

import click

from rtask.cli.options import data_option, json_option, print_json, read_text


@click.command()
@click.argument("text", required=False)
@data_option
@click.option("--file", "-f", type=click.Path(path_type=Path), help="Read the update from a file.")
@click.option("--agent", help="Write as this robot or person, into its own graph.")
@click.option("--note", help="Kept with the provenance.")
@json_option
def update(
    text: str | None,
    data: Path,
    file: Path | None,
    agent: str | None,
    note: str | None,
    as_json: bool,
) -> None:
    """Change the graph in SPARQL; TEXT may be - for standard input.

    One commit: wholly or not at all.
    """
    import rtask

    asked = read_text(text, file)
    with rtask.open(data) as kb:
        done = kb.update(asked, agent=agent, note=note)
    if as_json:
        names = ("seq", "added", "removed", "derived")
        print_json({name: getattr(done, name) for name in names})
        return
    click.echo(f"commit {done.seq}: +{done.added} -{done.removed}, {done.derived} derived")
