"""``rtask migrate``: make things of the products in a graph that is older than things."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from rtask.cli.connection import open_to_change
from rtask.cli.options import announce_undo, data_option, json_option, print_json
from rtask.cli.progress import Working, announce_compilation

__all__ = ["migrate"]


@click.command()
@click.option("--undo", is_flag=True, help="Undo it; possible until something else is written.")
@data_option
@json_option
def migrate(undo: bool, data: Path, as_json: bool) -> None:
    """Make things of products that robots saw before things were told apart.

    What robots reported is carried out again in the order of time, and becomes things with their
    places. Each product is a commit: others may read meanwhile, and a run that was killed goes on.
    """
    from rtask.engine.curation.older_graphs import migrate as migrate_products
    from rtask.engine.curation.older_graphs import undo_migration

    with announce_compilation(), Working("making things of products"), open_to_change(data) as kb:
        if undo:
            undone = undo_migration(kb)
        else:
            made = migrate_products(kb)
    if undo:
        if as_json:
            print_json({"undone": undone})
        else:
            click.echo(f"{len(undone)} commits are undone")
        return
    if as_json:
        print_json(asdict(made))
        return
    click.echo(
        f"{made.products} products have {made.exemplars} things with {made.placements} places"
    )
    if made.skipped:
        click.echo(
            f"{len(made.skipped)} products have things already: what was reported before stays as "
            "it is; --json names them"
        )
    if made.commits is not None:
        announce_undo("migrate", "--undo")
