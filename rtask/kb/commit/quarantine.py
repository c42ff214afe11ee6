"""Quarantine: statements set aside because they contradict the rest, each with its reason.

The graph ``{base}graph/quarantine`` holds each statement unchanged, together with an
``rdf:Statement`` that records the intended graph, the reason and the commit that added it. The
reasoner does not read this graph, and it is not part of the union.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from pyoxigraph import Quad

from rtask.errors import UsageError
from rtask.kb.commit.access import Access
from rtask.kb.commit.inference import Inference, Staged
from rtask.kb.rules.rule import Rule
from rtask.kb.store.graph_store import GraphStore
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.overlay import Overlay
from rtask.kb.store.quads import Derived
from rtask.rdf.terms import RDF_TYPE, NamedNode, TripleKey, iri, literal, triple_key

__all__ = [
    "RESTS_IN", "Quarantined", "record", "records_in", "reinstate", "set_aside", "statements",
]  # fmt: skip

_RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
_STATEMENT = iri(_RDF + "Statement")
_PARTS = tuple(iri(_RDF + name) for name in ("subject", "predicate", "object"))
RESTS_IN = iri("http://purl.org/dc/terms/isPartOf")
"""Leads from a record to the graph of its statement."""
_REASON = iri("http://www.w3.org/2000/01/rdf-schema#comment")
_COMMIT = iri("http://www.w3.org/ns/prov#wasGeneratedBy")
_ROUNDS = 20
"""Setting statements aside may uncover further clashes, each round at least one fewer."""


@dataclass(frozen=True)
class Quarantined:
    """A statement in quarantine.

    Parameters
    ----------
    node
        IRI of its record in the quarantine graph.
    quad
        The statement, in its intended graph.
    reason
        Description of the contradiction.
    activity
        The commit that added it.
    """

    node: NamedNode
    quad: Quad
    reason: str
    activity: NamedNode


def set_aside(
    change: Overlay,
    inference: Inference,
    graphs: Graphs,
    seq: int,
    rules: Sequence[Rule] | None = None,
    budget: Any = None,
) -> tuple[Derived, Staged, int]:
    """Move contradictory statements from a pending change into the quarantine graph.

    Parameters
    ----------
    rules
        All rules of the user from now on, if the change concerns any.
    budget
        Bounds of what may follow, a :class:`reasoner.ChangeBudget`.

    Returns
    -------
    The derived change and the staged closure of what is left, and the number of statements moved.

    Raises
    ------
    InconsistentError
        If none of the added statements causes the contradiction, e.g. after a deletion.
    """
    moved, before = 0, records_in(change)
    for _ in range(_ROUNDS):
        derived, staged, clashes = inference.try_stage(change, rules, budget)
        if staged is not None:
            return derived, staged, moved
        blamed = _blamed(change, clashes, inference)
        if not blamed:
            raise inference.inconsistent(clashes)
        for quad, reason in blamed.items():
            del change.added[quad]
            moved += 1
            for line in record(graphs, quad, reason, seq, before + moved):
                change.add(line)
    raise inference.inconsistent(clashes)


def _blamed(change: Overlay, clashes: Sequence[Any], inference: Inference) -> dict[Quad, str]:
    """Return the added statements that cause contradictions, each with its first reason."""
    added: dict[TripleKey, list[Quad]] = {}
    for quad in change.added:
        # Only what takes part in reasoning can be to blame; the rest would be moved for nothing.
        if inference.is_input(quad.graph_name):
            added.setdefault(triple_key(quad), []).append(quad)
    blamed: dict[Quad, str] = {}
    for clash in clashes:
        for triple in (*clash.triples, *clash.culprits(), *clash.axioms):
            for quad in added.get(triple, ()):
                blamed.setdefault(quad, clash.message)
    return blamed


def records_in(change: Overlay) -> int:
    """Return how many statements a change moves to quarantine."""
    return sum(quad.predicate == RESTS_IN for quad in change.added)


def record(graphs: Graphs, quad: Quad, reason: str, seq: int, number: int) -> Iterator[Quad]:
    """Yield what the quarantine holds of a statement, the n-th that a commit sets aside."""
    here, node = graphs.quarantine, iri(f"{graphs.base}quarantine/{seq}/{number}")
    yield Quad(quad.subject, quad.predicate, quad.object, here)
    yield Quad(node, RDF_TYPE, _STATEMENT, here)
    for predicate, term in zip(_PARTS, triple_key(quad), strict=True):
        yield Quad(node, predicate, term, here)
    if isinstance(quad.graph_name, NamedNode):
        yield Quad(node, RESTS_IN, quad.graph_name, here)
    yield Quad(node, _REASON, literal(reason), here)
    yield Quad(node, _COMMIT, iri(f"{graphs.base}activity/{seq}"), here)


def statements(store: GraphStore, graphs: Graphs) -> list[Quarantined]:
    """Return the statements in quarantine, in the order of their commits."""
    here = graphs.quarantine
    quarantined = []
    for quad in store.quads_for_pattern(None, RDF_TYPE, _STATEMENT, here):
        facts = {
            q.predicate: q.object for q in store.quads_for_pattern(quad.subject, None, None, here)
        }
        if all(part in facts for part in (*_PARTS, RESTS_IN, _REASON, _COMMIT)):
            subject, predicate, value = (facts[part] for part in _PARTS)
            statement = Quad(subject, predicate, value, facts[RESTS_IN])  # type: ignore[arg-type]
            reason = getattr(facts[_REASON], "value", "")
            quarantined.append(Quarantined(quad.subject, statement, reason, facts[_COMMIT]))  # type: ignore[arg-type]
    return sorted(quarantined, key=lambda entry: _number(entry.node))


def _number(node: NamedNode) -> tuple[int, ...]:
    # By number: as text, the tenth would come before the second.
    return tuple(int(part) for part in node.value.rsplit("/", 2)[-2:] if part.isdecimal())


def reinstate(
    overlay: Overlay, graphs: Graphs, nodes: Iterable[str] | None, drop: bool, access: Access
) -> None:
    """Return statements to their graphs in a pending change, or delete them with ``drop``.

    Raises
    ------
    ForbiddenError
        If the caller may not write one of the graphs; the error names it.
    UsageError
        There is no such record.
    """
    quarantined = {
        statement.node.value: statement for statement in statements(overlay.store, graphs)
    }
    chosen = set(quarantined) if nodes is None else set(nodes)
    if not chosen <= quarantined.keys():
        raise UsageError(f"nothing in quarantine is named {min(chosen - quarantined.keys())}")
    here = graphs.quarantine
    # Two graphs may have said the same, and the quarantine holds it once: it stays for the other.
    staying = {
        triple_key(statement.quad) for name, statement in quarantined.items() if name not in chosen
    }
    for statement in (quarantined[name] for name in sorted(chosen)):
        # Else whoever may write the quarantine could put statements into anybody's graph.
        access.require_write(statement.quad.graph_name, "release")
        for line in list(overlay.store.quads_for_pattern(statement.node, None, None, here)):
            overlay.remove(line)
        subject, predicate, value = triple_key(statement.quad)
        if (subject, predicate, value) not in staying:
            overlay.remove(Quad(subject, predicate, value, here))
        if not drop:
            overlay.add(statement.quad)
