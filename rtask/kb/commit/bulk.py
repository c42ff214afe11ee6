"""Bulk loads: add more statements than a commit may hold, e.g. from a large file.

The statements are stored in one atomic step between two checkpoints, followed by a commit of the
statements derived from them. A mark in the folder shows that a load is under way, so that opening
the folder after a crash completes it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import IO, NamedTuple

from pyoxigraph import Quad, RdfFormat, parse

from rtask.errors import ForbiddenError, UsageError
from rtask.kb.commit.access import Access
from rtask.kb.commit.checks.testimony import require_own_testimony
from rtask.kb.commit.commit import MAX_QUADS, Commit, Request
from rtask.kb.commit.committer import PROOF_BUDGET, Committer
from rtask.kb.commit.foreign.identity import (
    MAX_MERGES,
    merge_refused,
    merge_remark,
    merges_of_others,
)
from rtask.kb.commit.foreign.supports import leaves_of
from rtask.kb.commit.inference import Inference
from rtask.kb.commit.quarantine import record
from rtask.kb.commit.schema_right import SchemaRight, axiom_refused
from rtask.kb.commit.writer import Writer
from rtask.kb.durability.folder import Files
from rtask.kb.durability.saved_closures import discard_saved
from rtask.kb.durability.settings import write_durably
from rtask.kb.store.apply import apply
from rtask.kb.store.embedded import EmbeddedStore
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.overlay import Holders
from rtask.kb.store.quads import InGraph, QuadChain
from rtask.kb.store.union import union_change
from rtask.kb.store.writes import Writes
from rtask.rdf.bounds import refuse_long_literal, refuse_long_names
from rtask.rdf.terms import DEFAULT, GraphName, NamedNode, iri

__all__ = ["BulkLoad", "TripleText", "bulk_add", "complete", "finish_bulk"]

_MARK = "loading.json"
_DERIVED_PART = 400_000
"""Each part becomes files of its own, which the store then merges, and so writes again; but the
store holds a part in memory: with 700,000 a load of 300,000 statements wrote 12 % less, and its
peak was 160 MB higher."""


@dataclass(frozen=True)
class TripleText:
    """A document without blank nodes, which the store parses itself.

    Parameters
    ----------
    open
        Returns a reader at the start of the text; may be called repeatedly.
    """

    open: Callable[[], IO[bytes]]
    format: RdfFormat
    base: str | None = None


class BulkLoad(NamedTuple):
    """Result of a bulk load.

    Parameters
    ----------
    derived
        How many statements the inferred graph gained.
    remark
        What the author is told of things that are one from now on; ``None`` if nothing.
    """

    derived: int
    remark: str | None = None


def bulk_add(
    writer: Writer,
    files: Files,
    inference: Inference | None,
    data: Iterable[Quad] | TripleText,
    graph: GraphName,
    request: Request,
) -> BulkLoad:
    """Add statements and what follows from them.

    Parameters
    ----------
    data
        Quads, read once and not kept, or a text that the store parses, which is faster. With a
        text, the graph becomes visible slightly before the union.
    graph
        Target graph; recorded in the mark.
    """
    committer = writer.committer
    inferred = committer.graphs.inferred
    before = committer.catalogue.triple_count(inferred)
    _refuse_rules(committer, graph)
    with writer.exclusive():
        request.access.require_write(graph, "load")
        if committer.late is not None:
            # A read would store them, and wait for a bulk load that waits for what was read.
            committer.late.flush()
        _checkpoint(files, committer.last_seq)
        if files.folder is not None:
            discard_saved(files.folder)
        # Killed from here on, the next start completes the load.
        _mark(files, graph, request.access)
        fresh: list[Quad] = []
        if isinstance(data, TripleText):
            touched = _add_text(files, committer, data, graph, request.access, fresh)
        else:
            touched = _add_quads(files, data, graph, request.access, committer, fresh)
        _checkpoint(files, committer.last_seq)
    remark = None
    if not files.settings.plain:
        named = frozenset(g for g in touched if isinstance(g, NamedNode))
        try:
            recounted = replace(request, trusted=True, recount=named)
            remark = finish_bulk(writer, inference, recounted, fresh).remark
        except ForbiddenError:
            _unmark(files)
            raise
        with writer.exclusive():
            _checkpoint(files, committer.last_seq)
            # Derived statements of a large load take minutes to find again after a crash.
            save = None if inference is None else inference.prepare_save(always=True)
        if save is not None:
            save()
    _unmark(files)
    return BulkLoad(committer.catalogue.triple_count(inferred) - before, remark)


def _add_text(
    files: Files,
    committer: Committer,
    text: TripleText,
    graph: GraphName,
    access: Access,
    fresh: list[Quad],
) -> set[GraphName]:
    store = files.store
    # The store parses faster, but shows nothing of what it reads; a robot's statements are checked.
    checks_each = access.role == "robot" or not access.may_state_axioms
    if not isinstance(store, EmbeddedStore) or (checks_each and not committer.plain):
        with text.open() as stream:
            parsed = parse(stream, format=text.format, base_iri=text.base)
            quads = (Quad(q.subject, q.predicate, q.object, graph) for q in parsed)
            return _add_quads(files, quads, graph, access, committer, fresh)
    for target in (graph, DEFAULT) if files.settings.is_merged else (graph,):
        try:
            with text.open() as stream:
                store.raw.bulk_load(stream, text.format, base_iri=text.base, to_graph=target)
        except BaseException:
            if target == graph:
                _unmark(files)
            else:
                committer.interrupted = True
            raise
        finally:
            store.changed()
    return {graph}


def _refuse_rules(committer: Committer, graph: GraphName) -> None:
    """Refuse rules in bulk: each is checked when it is added."""
    if not committer.plain and graph == committer.graphs.rules:
        raise UsageError(
            f"{graph} takes no bulk loads; add rules with kb.add_rules() or `rtask rules add`"
        )


def _add_quads(
    files: Files,
    quads: Iterable[Quad],
    graph: GraphName,
    access: Access,
    committer: Committer,
    fresh: list[Quad],
) -> set[GraphName]:
    joined: dict[GraphName, bool] = {graph: files.settings.is_merged and Graphs.is_joined(graph)}

    right = None
    store = files.store
    if not access.may_state_axioms:
        declared = committer.catalogue.declared()
        right = SchemaRight(access, committer.graphs, store, declared)
    names_agents = access.role in ("robot", "teacher") and not committer.plain
    holders = Holders(store)

    def with_union() -> Iterator[Quad]:
        for quad in quads:
            name = quad.graph_name
            refuse_long_literal(quad.object, f"{quad.subject} {quad.predicate}")
            refuse_long_names(quad)
            if right is not None:
                if right.is_foreign(quad):
                    raise axiom_refused(quad, access, committer.graphs)
                # What was there before the load is not withdrawn with it.
                if quad not in store:
                    fresh.append(quad)
            if names_agents:
                access.require_own_identity(quad, committer.graphs)
                require_own_testimony((quad,), access, committer.graphs, holders)
            if name not in joined:
                _refuse_rules(committer, name)
                access.require_write(name, "load")
                joined[name] = files.settings.is_merged and Graphs.is_joined(name)
            yield quad
            if joined[name]:
                # The union has each triple beside the graph's own copy.
                yield Quad(quad.subject, quad.predicate, quad.object, DEFAULT)

    try:
        files.store.bulk_extend(with_union())
    except BaseException:
        _unmark(files)
        raise
    return set(joined)


def finish_bulk(
    writer: Writer,
    inference: Inference | None,
    request: Request,
    fresh: Collection[Quad] = (),
    records: Collection[Quad] = (),
) -> Commit:
    """Recompute the inferred graph and commit the difference.

    A difference that exceeds the size of a commit is stored directly beforehand. This is as safe
    as an atomic step: until the commit, the catalogue marks the inferred graph as behind.

    Parameters
    ----------
    fresh
        Statements stored before, to be withdrawn if the caller may not state what follows.
    records
        Of statements that go to quarantine.

    Raises
    ------
    ForbiddenError
        It follows that individuals of others are the same.
    """
    overlay, remark = writer.begin(), None
    try:
        overlay.add_all(records)
        if inference is not None:
            missing, surplus = inference.difference()
            if fresh:
                _require_identity(writer.committer, inference, missing, request.access, fresh)
            remark = merge_remark(missing, overlay.store, writer.committer.graphs)
            overlay.removed.update(dict.fromkeys(surplus))
            if len(missing) <= MAX_QUADS:
                overlay.added.update(dict.fromkeys(missing))
            else:
                # Too many for one commit: stored first, and then counted by the commit.
                _add_derived(overlay.store, missing)
                request = replace(request, recount=request.recount | {missing.graph})
    except BaseException:
        writer.cancel()
        raise
    return replace(writer.finish(overlay, request), remark=remark)


def _require_identity(
    committer: Committer,
    inference: Inference,
    missing: InGraph,
    access: Access,
    fresh: Collection[Quad],
) -> None:
    """Withdraw what was stored, and raise, if others' individuals follow to be the same."""
    store, graphs = committer.store, committer.graphs
    merges = [*islice(merges_of_others(missing, access, graphs, store), MAX_MERGES)]
    if not merges:
        return
    error = merge_refused(merges, fresh, store, access, graphs)
    removed = dict.fromkeys(fresh)
    union = () if store.is_view else union_change(store, removed, ()).removed
    apply(store, Writes(QuadChain(removed, union)))
    # What follows is compared with the store again, from which the load has gone.
    inference.difference()
    raise error


def _add_derived(store: GraphStore, derived: InGraph) -> None:
    """Store derived statements, and their copies for the union first."""
    for part in derived.parts(_DERIVED_PART):
        if not store.is_view:
            store.bulk_extend(InGraph(part.triples, DEFAULT))
        store.bulk_extend(part)


def complete(writer: Writer, files: Files, inference: Inference | None, access: Access) -> bool:
    """Complete a bulk load that a crash interrupted; return whether there was one."""
    mark = _mark_file(files)
    if mark is None or not mark.exists():
        return False
    load = json.loads(mark.read_text("utf-8"))
    name, author = load["graph"], load.get("checked")
    if name and not files.settings.plain:
        store = files.store
        if files.settings.is_merged:
            # A killed load may have filled the graph and not the union; what both have is stored
            # once.
            store.bulk_extend(
                Quad(quad.subject, quad.predicate, quad.object)
                for quad in store.quads_for_pattern(None, None, None, iri(name))
            )
        recount = _miscounted(writer.committer, store) | {iri(name)}
        note = "complete an interrupted load"
        request = Request(access, note=note, trusted=True, recount=recount)
        merging: list[Quad] = []
        if author and inference is not None:
            merging = _withdraw_merging(writer, inference, iri(name), Access(author, "robot"))
        finish_bulk(writer, inference, request, records=_records(writer, merging))
    _unmark(files)
    return True


def _withdraw_merging(
    writer: Writer, inference: Inference, graph: NamedNode, access: Access
) -> list[Quad]:
    """Withdraw what a load that was cut short would have been refused for; return it.

    Nobody knows any more which statements of the graph it brought, so only those go from which it
    follows that individuals of others are the same.
    """
    committer = writer.committer
    store, bound = committer.store, access.bind(committer.graphs)
    gone: list[Quad] = []
    with writer.exclusive():
        # What is withdrawn may have hidden another merge; each round removes at least one
        # statement.
        for _ in range(MAX_MERGES):
            missing, _surplus = inference.difference()
            pairs = merges_of_others(missing, bound, committer.graphs, store)
            proofs = [inference.explain(pair, PROOF_BUDGET) for pair in islice(pairs, MAX_MERGES)]
            supports = [leaves_of(proof).statements for proof in proofs if proof.holds]
            quads = dict.fromkeys(Quad(*t, graph) for support in supports for t in support)
            removed = dict.fromkeys(quad for quad in quads if quad in store)
            if not removed:
                return gone
            union = () if store.is_view else union_change(store, removed, ()).removed
            apply(store, Writes(QuadChain(removed, union)))
            gone += removed
    return gone


def _records(writer: Writer, quads: Collection[Quad]) -> list[Quad]:
    """Return what the quarantine holds of statements that a load left."""
    graphs, seq = writer.committer.graphs, writer.committer.last_seq + 1
    reason = "a load that was cut short: others' individuals would be one with another"
    return [
        line
        for number, quad in enumerate(quads, 1)
        for line in record(graphs, quad, reason, seq, number)
    ]


def take_in(writer: Writer, files: Files, inference: Inference | None, access: Access) -> bool:
    """Count and close statements of commits that the journal lost; return whether there were any.

    When a machine stops, the store may keep the statements of a commit that was never acknowledged,
    without its notes.
    """
    if not files.may_be_ahead or files.settings.plain or files.folder is None:
        return False
    discard_saved(files.folder)
    recount = _miscounted(writer.committer, files.store)
    if recount:
        note = "take in what was stored when the machine stopped"
        finish_bulk(writer, inference, Request(access, note=note, trusted=True, recount=recount))
    return bool(recount)


def _miscounted(committer: Committer, store: GraphStore) -> frozenset[GraphName]:
    """Return the graphs that hold another number of statements than the catalogue says."""
    catalogue, graphs = committer.catalogue, committer.graphs
    miscounted = {g for g in store.named_graphs() if store.count(g) != catalogue.triple_count(g)}
    return frozenset(miscounted - {graphs.meta, graphs.provenance})


def _mark_file(files: Files) -> Path | None:
    return None if files.folder is None else files.folder / _MARK


def _mark(files: Files, graph: GraphName, access: Access) -> None:
    mark = _mark_file(files)
    if mark is not None:
        by = None if access.may_state_axioms else access.agent
        load = {"graph": getattr(graph, "value", ""), "checked": by}
        write_durably(mark, json.dumps(load) + "\n")


def _unmark(files: Files) -> None:
    mark = _mark_file(files)
    if mark is not None:
        mark.unlink(missing_ok=True)


def _checkpoint(files: Files, seq: int) -> None:
    if files.checkpoints is not None:
        files.checkpoints.make(seq)
