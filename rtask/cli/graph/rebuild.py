"""``rtask rebuild``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rtask.cli.options import data_option

if TYPE_CHECKING:
    from rtask.knowledge_base import KnowledgeBase

_FILES = ("store", "journal")
_PARTS = ("union", "catalogue", "inferred", "index", "statistics", "recognition", "models", "blobs")


@click.command()
@click.argument("what", type=click.Choice([*_PARTS, *_FILES, "all"]), default="inferred")
@data_option
def rebuild(what: str, data: Path) -> None:
    """Derive again what is derived: the graph is the truth, the rest follows from it.

    union and catalogue of graphs, the inferred graph, the index of texts and places, the statistics
    of grasps, the recognition index, the models of objects; blobs deletes bytes that no statement
    has named for a day.

    After damage, on a folder that nobody has open: "store" makes the quads again from a complete
    journal; "journal" goes on without a journal that is lost. What is replaced is set aside.
    """
    import rtask

    if what in _FILES:
        from rtask.kb.durability.rebuild import rebuild_journal, rebuild_store

        last = rebuild_store(data) if what == "store" else rebuild_journal(data)
        click.echo(f"{what}: up to commit {last}")
        return

    with rtask.open(data) as kb:
        for part in _PARTS if what == "all" else (what,):
            click.echo(f"{part}: {_rebuild(kb, part)}")


def _rebuild(kb: KnowledgeBase, part: str) -> str:
    if part == "inferred":
        done = kb.rebuild("inferred")
        return f"+{done.added} -{done.removed}"
    if part == "blobs":
        return f"{kb.collect_blobs()} deleted"
    if part in ("statistics", "recognition", "models"):
        return _rebuild_engine(kb, part)
    findings = kb.verify(repair=True, parts=(part,))
    return "; ".join(finding.detail for finding in findings) or "as it should be"


def _rebuild_engine(kb: KnowledgeBase, part: str) -> str:
    from rtask.engine import Engine

    engine = Engine(kb)
    try:
        if part == "recognition":
            return f"{engine.rebuild_index()} views"
        if part == "models":
            return f"{engine.rebuild_models()} objects"
        done = engine.rebuild_statistics()
        return f"+{done.added} -{done.removed}"
    finally:
        engine.close()
