"""Statements beyond the size of a commit, e.g. of a large file.

They go into the store in one atomic step between two checkpoints; a commit for what follows from
them comes right after. A mark in the folder says that such a step is under way, so that an open
after a crash completes it.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from pyoxigraph import Quad

from rtask.kb.access import Access
from rtask.kb.commit import MAX_QUADS, Commit, Request
from rtask.kb.folder import Files
from rtask.kb.inference import Inference
from rtask.kb.settings import write_durably
from rtask.kb.terms import DEFAULT, DefaultGraph, Graph, NamedNode, iri
from rtask.kb.writer import Writer

__all__ = ["bulk_add", "complete", "finish_bulk"]

_MARK = "loading.json"


def bulk_add(
    writer: Writer,
    files: Files,
    inference: Inference | None,
    quads: Iterable[Quad],
    graph: Graph,
    request: Request,
) -> int:
    """Add statements; return how many the inferred graph then holds more.

    Parameters
    ----------
    quads
        Read once, not kept.
    graph
        Where they go; named in the mark.
    """
    committer, plain = writer.committer, files.settings.plain
    touched: set[Graph] = {graph}
    inferred = committer.graphs.inferred
    before = committer.catalogue.triple_count(inferred)
    with writer.exclusive():
        request.access.require_write(graph, "load")
        _mark(files, graph)
        _checkpoint(files, committer.last_seq)
        files.store.raw.bulk_extend(_with_union(quads, request.access, touched, plain))
        _checkpoint(files, committer.last_seq)
    if not plain:
        named = frozenset(g for g in touched if isinstance(g, NamedNode))
        finish_bulk(writer, inference, replace(request, trusted=True, recount=named))
        _checkpoint(files, committer.last_seq)
    _unmark(files)
    return committer.catalogue.triple_count(inferred) - before


def _with_union(
    quads: Iterable[Quad], access: Access, touched: set[Graph], plain: bool
) -> Iterator[Quad]:
    """Yield each statement, and its copy for the union; the store keeps one of equal ones."""
    for quad in quads:
        if quad.graph_name not in touched:
            access.require_write(quad.graph_name, "load")
            touched.add(quad.graph_name)
        yield quad
        if not plain and not isinstance(quad.graph_name, DefaultGraph):
            yield Quad(quad.subject, quad.predicate, quad.object, DEFAULT)


def finish_bulk(writer: Writer, inference: Inference | None, request: Request) -> Commit:
    """Derive everything anew; one commit of the difference.

    What is missing beyond the size of a commit goes into the store right away. That is as good as
    atomic: until the commit, the catalogue says that the inferred graph is behind.
    """
    overlay = writer.begin()
    try:
        if inference is not None:
            missing, surplus = inference.difference()
            overlay.removed.update(dict.fromkeys(surplus))
            overlay.added.update(dict.fromkeys(itertools.islice(missing, MAX_QUADS)))
            rest = next(missing, None)
            if rest is not None:
                graph = writer.committer.graphs.inferred
                quads = itertools.chain(overlay.added, (rest,), missing)
                overlay.store.raw.bulk_extend(_with_copies(quads))
                overlay.added.clear()
                request = replace(request, recount=request.recount | {graph})
    except BaseException:
        writer.cancel()
        raise
    return writer.finish(overlay, request)


def _with_copies(quads: Iterable[Quad]) -> Iterator[Quad]:
    """Yield each statement, and its copy for the union; the store keeps one of equal ones."""
    for quad in quads:
        yield quad
        yield Quad(quad.subject, quad.predicate, quad.object, DEFAULT)


def complete(writer: Writer, files: Files, inference: Inference | None, access: Access) -> bool:
    """Finish what a crash interrupted; whether there was anything."""
    mark = _mark_file(files)
    if mark is None or not mark.exists():
        return False
    name = json.loads(mark.read_text("utf-8"))["graph"]
    if name and not files.settings.plain:
        note = "complete an interrupted load"
        recount: frozenset[Graph] = frozenset({iri(name)})
        request = Request(access, note=note, trusted=True, recount=recount)
        finish_bulk(writer, inference, request)
    _unmark(files)
    return True


def _mark_file(files: Files) -> Path | None:
    return None if files.folder is None else files.folder / _MARK


def _mark(files: Files, graph: Graph) -> None:
    mark = _mark_file(files)
    if mark is not None:
        write_durably(mark, json.dumps({"graph": getattr(graph, "value", "")}) + "\n")


def _unmark(files: Files) -> None:
    mark = _mark_file(files)
    if mark is not None:
        mark.unlink(missing_ok=True)


def _checkpoint(files: Files, seq: int) -> None:
    if files.checkpoints is not None:
        files.checkpoints.make(seq)
