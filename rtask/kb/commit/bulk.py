"""Bulk loads: more statements than a commit may hold, e.g. of a large file.

They go into the store in one atomic step between two checkpoints; a commit for what follows from
them comes right after. A mark in the folder says that such a step is under way, so that an open
after a crash completes it.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO

from pyoxigraph import Quad, RdfFormat

from rtask.kb.commit.access import Access
from rtask.kb.commit.commit import MAX_QUADS, Commit, Committer, Request
from rtask.kb.commit.inference import Inference
from rtask.kb.commit.writer import Writer
from rtask.kb.durability.folder import Files
from rtask.kb.durability.settings import write_durably
from rtask.kb.store.union import is_joined
from rtask.rdf.terms import DEFAULT, GraphName, NamedNode, iri

__all__ = ["TripleText", "bulk_add", "complete", "finish_bulk"]

_MARK = "loading.json"


@dataclass(frozen=True)
class TripleText:
    """A document that the store parses itself: triples without blank nodes.

    Parameters
    ----------
    open
        Gives the text from its start, as often as asked.
    """

    open: Callable[[], IO[bytes]]
    format: RdfFormat
    base: str | None = None


def bulk_add(
    writer: Writer,
    files: Files,
    inference: Inference | None,
    data: Iterable[Quad] | TripleText,
    graph: GraphName,
    request: Request,
) -> int:
    """Add statements; return how many the inferred graph gained.

    Parameters
    ----------
    data
        Read once, not kept; or a text that the store reads, which is faster. Of a text the graph
        is there a moment before the union.
    graph
        Where they go; named in the mark.
    """
    committer = writer.committer
    inferred = committer.graphs.inferred
    before = committer.catalogue.triple_count(inferred)
    with writer.exclusive():
        request.access.require_write(graph, "load")
        _checkpoint(files, committer.last_seq)
        _mark(files, graph)
        if isinstance(data, TripleText):
            touched = _add_text(files, committer, data, graph)
        else:
            touched = _add_quads(files, data, graph, request.access)
        _checkpoint(files, committer.last_seq)
    if not files.settings.plain:
        named = frozenset(g for g in touched if isinstance(g, NamedNode))
        finish_bulk(writer, inference, replace(request, trusted=True, recount=named))
        _checkpoint(files, committer.last_seq)
    _unmark(files)
    return committer.catalogue.triple_count(inferred) - before


def _add_text(
    files: Files, committer: Committer, text: TripleText, graph: GraphName
) -> set[GraphName]:
    for target in (graph, DEFAULT) if files.settings.is_merged else (graph,):
        try:
            with text.open() as stream:
                files.store.raw.bulk_load(stream, text.format, base_iri=text.base, to_graph=target)
        except BaseException:
            if target == graph:
                _unmark(files)
            else:
                committer.interrupted = True
            raise
    return {graph}


def _add_quads(
    files: Files, quads: Iterable[Quad], graph: GraphName, access: Access
) -> set[GraphName]:
    joined: dict[GraphName, bool] = {graph: files.settings.is_merged and is_joined(graph)}

    def with_union() -> Iterator[Quad]:
        for quad in quads:
            name = quad.graph_name
            if name not in joined:
                access.require_write(name, "load")
                joined[name] = files.settings.is_merged and is_joined(name)
            yield quad
            if joined[name]:
                yield Quad(quad.subject, quad.predicate, quad.object, DEFAULT)

    try:
        files.store.raw.bulk_extend(with_union())
    except BaseException:
        _unmark(files)
        raise
    return set(joined)


def finish_bulk(writer: Writer, inference: Inference | None, request: Request) -> Commit:
    """Recompute the inferred graph and commit the difference.

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
                overlay.store.raw.bulk_extend(_with_copies(quads, not overlay.store.is_view))
                overlay.added.clear()
                request = replace(request, recount=request.recount | {graph})
    except BaseException:
        writer.cancel()
        raise
    return writer.finish(overlay, request)


def _with_copies(quads: Iterable[Quad], merged: bool) -> Iterator[Quad]:
    """Yield each statement and its copy for the union; the store ignores duplicates."""
    for quad in quads:
        yield quad
        if merged:
            yield Quad(quad.subject, quad.predicate, quad.object, DEFAULT)


def complete(writer: Writer, files: Files, inference: Inference | None, access: Access) -> bool:
    """Complete a bulk load that a crash interrupted; return whether there was one."""
    mark = _mark_file(files)
    if mark is None or not mark.exists():
        return False
    name = json.loads(mark.read_text("utf-8"))["graph"]
    if name and not files.settings.plain:
        store, catalogue = files.store, writer.committer.catalogue
        if files.settings.is_merged:
            store.raw.bulk_extend(
                Quad(quad.subject, quad.predicate, quad.object)
                for quad in store.quads_for_pattern(None, None, None, iri(name))
            )
        kept = (writer.committer.graphs.meta, writer.committer.graphs.provenance)
        changed = {g for g in store.named_graphs() if store.count(g) != catalogue.triple_count(g)}
        recount = frozenset(changed - {*kept} | {iri(name)})
        note = "complete an interrupted load"
        finish_bulk(writer, inference, Request(access, note=note, trusted=True, recount=recount))
    _unmark(files)
    return True


def _mark_file(files: Files) -> Path | None:
    return None if files.folder is None else files.folder / _MARK


def _mark(files: Files, graph: GraphName) -> None:
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
