"""A new knowledge base in memory as the copy of one that was opened before.

Opening one takes .12 s of processor time, most of it to write the ontology and what follows from it
into the store, and hundreds of tests begin with a new one. A copy takes a quarter. Rooms whose
tests are about opening, loading and reasoning open theirs as users do.
"""

from __future__ import annotations

import functools
import os
from dataclasses import dataclass, replace
from typing import Any

from pyoxigraph import Literal, NamedNode, Quad

from reasoner import Closure
from reasoner.facts.relations import Facts
from reasoner.fixpoint.maintenance import State
from reasoner.terms.dictionary import Dictionary
from rtask import opening
from rtask.kb.commit.commit import Change
from rtask.kb.durability.folder import open_in_memory
from rtask.kb.durability.settings import Settings
from rtask.kb.store.embedded import EmbeddedStore
from rtask.kb.store.graphs import Graphs
from rtask.rdf.terms import TripleKey, triple_key

_AS_USERS_DO = (
    "tests/conformance/", "tests/ontology/", "tests/packaging/", "tests/reasoner/",
    "tests/rtask/kb/", "tests/rtask/loader/", "tests/rtask/remote/",
)  # fmt: skip
_BASE = "https://example.org/of-the-original/"
_open_as_usual = opening._assemble


@dataclass(frozen=True)
class _Original:
    """What a copy is made of.

    Parameters
    ----------
    shared
        Statements that do not name the base.
    inferred
        The statements of the inferred graph, of which only the graph names it.
    own
        All others.
    change
        The commit that wrote the ontology, as the feed remembers it.
    """

    shared: list[Quad]
    inferred: list[TripleKey]
    own: list[Quad]
    closure: Any
    change: Change


@functools.cache
def _original(reason: bool, validate: str) -> _Original:
    options = opening._Options("rw", True, reason, True, False, validate, (), ())
    kb = _open_as_usual(open_in_memory(Settings.new(_BASE, False, None)), options)
    try:
        own: list[Quad] = []
        shared: list[Quad] = []
        inferred: list[TripleKey] = []
        for quad in kb.store.quads_for_pattern(None, None, None, None):
            if quad.graph_name == kb.graphs.inferred:
                inferred.append(triple_key(quad))
            else:
                (own if _BASE in str(quad) else shared).append(quad)
        assert not [triple for triple in inferred if _BASE in "".join(map(str, triple))]
        closure = kb._inference.closure() if kb._inference is not None else None
        (change,) = kb.feed.changes(0, 1)
        return _Original(shared, inferred, own, closure, change)
    finally:
        kb.close()


def _moved(quad: Quad, base: str) -> Quad:
    """Return a statement of the original as one of a knowledge base with another base."""

    def move(term: Any) -> Any:
        if isinstance(term, NamedNode):
            return NamedNode(term.value.replace(_BASE, base))
        if isinstance(term, Literal) and _BASE in term.value:
            return Literal(term.value.replace(_BASE, base), datatype=term.datatype)
        return term

    return Quad(*map(move, (quad.subject, quad.predicate, quad.object, quad.graph_name)))


def _moved_change(change: Change, base: str) -> Change:
    """Return the commit that wrote the ontology, without what it derived."""
    activity = change.commit.activity
    if activity is not None:
        activity = NamedNode(activity.value.replace(_BASE, base))
    added = tuple(_moved(quad, base) if _BASE in str(quad) else quad for quad in change.added)
    commit = replace(change.commit, activity=activity)
    return replace(change, commit=commit, added=added, inferred_added=())


def _copied_terms(terms: Dictionary) -> Dictionary:
    copy = Dictionary()
    for name, value in vars(terms).items():
        setattr(copy, name, value.copy() if isinstance(value, dict | list) else value)
    return copy


def _copied(closure: Closure) -> Closure:
    """Return a closure that changes apart from the original; what never changes is shared."""
    copy = Closure(closure._rules, closure._config)
    state = closure._state
    copy._terms = _copied_terms(closure._terms)
    copy._state = State(
        Facts.of(state.asserted.columns()), Facts.of(state.facts.columns()), state.equality.copy(),
        state.program, state.problems, dict(state.clashes),
    )  # fmt: skip
    copy._reifiers, copy._skipped = set(closure._reifiers), closure._skipped
    return copy


def _is_copied(files: Any, options: Any) -> bool:
    test, settings = os.environ.get("PYTEST_CURRENT_TEST", ""), files.settings
    return (
        test.startswith("tests/")
        and not test.startswith(_AS_USERS_DO)
        and isinstance(files.store, EmbeddedStore)
        and files.folder is None
        and options.ontologies
        and not (options.rules or options.shapes or options.quarantines)
        and not (settings.plain or settings.is_view)
        and next(iter(files.store.named_graphs()), None) is None  # not one of an earlier version
    )


def open_copied(files: Any, options: Any) -> Any:
    """Open a new knowledge base by copying the original."""
    original = _original(options.reason, options.validate)
    base = files.settings.base
    graph = Graphs(base).inferred
    files.store.raw.bulk_extend(original.shared)
    files.store.raw.bulk_extend(Quad(s, p, o, graph) for s, p, o in original.inferred)
    files.store.raw.bulk_extend(_moved(quad, base) for quad in original.own)
    kb = _open_as_usual(files, options)
    if kb._inference is not None:
        kb._inference._closure = _copied(original.closure)
    # The first commit can be read again, as it can where it was made.
    kb.feed._oldest = 1
    kb.feed._remember(_moved_change(original.change, base))
    return kb


def open_by_copying() -> None:
    """From now on, open new knowledge bases of tests in memory by copying."""

    def assemble(files: Any, options: Any) -> Any:
        return (open_copied if _is_copied(files, options) else _open_as_usual)(files, options)

    opening._assemble = assemble


def prepare_original() -> None:
    """Make the original with reasoning now, for processes that are forked from this one."""
    _original(True, "off")
