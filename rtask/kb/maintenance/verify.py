"""Consistency check: compare derived data with a recount, and blobs with their digests."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator
from dataclasses import dataclass

from pyoxigraph import NamedNode, Quad

from rtask.errors import StoreError
from rtask.kb.commit.commit import Request
from rtask.kb.commit.inference import Inference
from rtask.kb.commit.writer import Writer
from rtask.kb.durability.blobs import PREFIX, digest_of
from rtask.kb.durability.journal import JournalFile
from rtask.kb.reasoning import Reasoning
from rtask.kb.store.apply import apply
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.writes import Writes
from rtask.rdf.terms import DEFAULT, GraphName, triple_key

__all__ = ["PARTS", "Finding", "collect_blobs", "verify"]

PARTS = ("journal", "blobs", "union", "catalogue", "closure", "index")
_LISTED = 20
_DAY_S = 86_400.0


@dataclass(frozen=True)
class Finding:
    """An inconsistency that the check found.

    Parameters
    ----------
    severity
        ``error``, or ``note`` for something that merely wastes space.
    part
        One of :data:`PARTS`.
    detail
        Description of the inconsistency.
    """

    severity: str
    part: str
    detail: str


def verify(
    kb: Reasoning,
    writer: Writer,
    inference: Inference | None,
    repair: bool = False,
    parts: Collection[str] = PARTS,
) -> list[Finding]:
    """Compare derived data with their sources.

    Parameters
    ----------
    repair
        Rebuild what can be computed from the graphs: union, catalogue, closure and index. Lost
        blobs cannot be restored.
    parts
        Parts to check.
    """
    findings: list[Finding] = []
    if "journal" in parts:
        findings += _journal(writer.committer.journal, kb.seq)
    if "blobs" in parts:
        findings += _blobs(kb)
    if kb.plain:
        return findings
    if "union" in parts:
        with writer.exclusive():
            findings += _union(kb, repair)
    if "catalogue" in parts:
        findings += _catalogue(kb, repair)
    if "closure" in parts and inference is not None:
        findings += _closure(kb, writer, inference, repair)
    if "index" in parts and repair:
        kb.index.rebuild()
    return findings


def _journal(journal: object, seq: int) -> Iterator[Finding]:
    if not isinstance(journal, JournalFile):
        return
    last = None
    try:
        for record in journal.records():
            if last is not None and record.seq != last + 1:
                yield Finding("error", "journal", f"commit {record.seq} follows {last}")
            last = record.seq
    except StoreError as error:
        yield Finding("error", "journal", str(error))
        return
    if last is not None and last != seq:
        yield Finding("error", "journal", f"ends at commit {last}, the store is at {seq}")


def _blobs(kb: Reasoning) -> Iterator[Finding]:
    named = _named_blobs(kb)
    stored = set(kb.blobs.digests())
    for digest in sorted(named - stored):
        yield Finding("error", "blobs", f"{PREFIX}{digest} is named, its bytes are not here")
    for digest in sorted(stored):
        if not kb.blobs.is_sound(digest):
            yield Finding("error", "blobs", f"{PREFIX}{digest} holds other bytes")
    if stored - named:
        yield Finding("note", "blobs", f"{len(stored - named)} are named by no statement")


def _named_blobs(kb: Reasoning) -> set[str]:
    return {
        digest
        for quad in kb.store.quads_for_pattern(None, None, None, None)
        for term in (quad.subject, quad.object)
        if isinstance(term, NamedNode) and term.value.startswith(PREFIX)
        if (digest := digest_of(term)) is not None
    }


def collect_blobs(
    kb: Reasoning, writer: Writer, older_than_s: float = _DAY_S, besides: Collection[str] = ()
) -> int:
    """Delete the blobs that no statement names; return how many.

    Parameters
    ----------
    older_than_s
        Minimum age. Younger blobs are kept, since a statement that names them may be about to be
        written. Storing a blob again resets its age.
    besides
        Digests that somebody else names.
    """
    with writer.exclusive():
        named = _named_blobs(kb)
        # Within the writer's lock: a blob is stored before the statement that names it. Those
        # younger than a day stay for the same reason.
        idle = [
            digest for digest in kb.blobs.digests() if digest not in named and digest not in besides
        ]
        return sum(kb.blobs.discard(digest, older_than_s) for digest in idle)


def _union(kb: Reasoning, repair: bool) -> Iterator[Finding]:
    store = kb.store
    # Read from the graphs at each query, it cannot disagree with them.
    if store.is_view:
        return
    # In both directions: a lost statement is not seen by queries, and one too many is seen that
    # nobody states.
    missing = [
        Quad(*triple_key(quad), DEFAULT)
        for quad in store.quads_for_pattern(None, None, None, None)
        if Graphs.is_joined(quad.graph_name)
        if Quad(*triple_key(quad), DEFAULT) not in store
    ]
    surplus = [
        quad
        for quad in store.quads_for_pattern(None, None, None, DEFAULT)
        if not any(
            Graphs.is_joined(other.graph_name)
            for other in store.quads_for_pattern(*triple_key(quad), None)
        )
    ]
    if not missing and not surplus:
        return
    yield Finding(
        "error", "union", f"{len(set(missing))} statements missing, {len(surplus)} too many"
    )
    if repair:
        apply(store, Writes(surplus, list(dict.fromkeys(missing))))


def _catalogue(kb: Reasoning, repair: bool) -> Iterator[Finding]:
    wrong: set[GraphName] = set()
    for graph in kb.store.named_graphs():
        if graph in (kb.graphs.meta, kb.graphs.provenance):
            continue
        count = sum(1 for _ in kb.store.quads_for_pattern(None, None, None, graph))
        listed = kb.catalogue.triple_count(graph)
        if count != listed:
            wrong.add(graph)
            yield Finding("error", "catalogue", f"{graph} holds {count}, listed with {listed}")
    if wrong and repair:
        request = Request(kb.access(), note="verify", trusted=True, recount=frozenset(wrong))
        with kb.commit_block(request):
            pass


def _closure(
    kb: Reasoning, writer: Writer, inference: Inference, repair: bool
) -> Iterator[Finding]:
    if inference.saved is not None:
        damaged = list(inference.saved.damaged())
        # A note: the closure is computed again, and only opening takes longer.
        yield from (Finding("note", "closure", detail) for detail in damaged)
        if damaged and repair:
            inference.saved.discard()
    with writer.exclusive():
        missing, surplus = inference.difference()
    examples = list(itertools.islice(itertools.chain(missing, surplus), _LISTED))
    if not examples:
        return
    yield Finding(
        "error",
        "closure",
        f"{len(missing)} derived statements missing, {len(surplus)} too many, "
        f"e.g. {' '.join(map(str, triple_key(examples[0])))}",
    )
    if repair:
        kb.rebuild("inferred")
