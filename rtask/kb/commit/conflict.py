"""Contradictions told to people: what clashes, and the smallest sets of statements behind it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from pyoxigraph import Quad

from rtask.errors import InconsistentError
from rtask.kb.commit.schema_right import is_axiom
from rtask.rdf.terms import DEFAULT, Term, TripleKey

__all__ = ["cause_of", "describe_cause", "inconsistent"]

Name = Callable[[Term], str]
GraphsOf = Callable[[TripleKey], list[str]]
OwnerOf = Callable[[str], str | None]
_LISTED = 6
_SHOWN = 4
_LISTED_STATEMENTS = 12


def inconsistent(
    contradictions: Sequence[Any],
    causes: Sequence[Any],
    name: Name,
    graphs_of: GraphsOf,
    owner_of: OwnerOf = lambda _: None,
) -> InconsistentError:
    """Return the error that lists contradictions and their causes.

    A contradiction that rests on an axiom which only robots or people state is charged to them,
    and not to the author of the data that it refuses.

    Parameters
    ----------
    contradictions
        :class:`reasoner.Contradiction`; at least one.
    causes
        :class:`reasoner.Cause`; may be empty.
    name
        Returns the short name of a term.
    graphs_of
        Returns the names of the graphs that assert a statement.
    owner_of
        Returns the robot or person whose graph has a name, or ``None``.
    """
    message = contradictions[0].message
    more = f" (and {len(contradictions) - 1} more)" if len(contradictions) > 1 else ""
    hint = ""
    # The commonest trap: Turtle reads 0.31 as a decimal, and the value spaces of decimals and
    # doubles are disjoint (XML Schema 2, 3.2).
    if "XMLSchema#decimal" in message:
        hint = "; a number with a point is an xsd:decimal, write 0.31e0 for an xsd:double"
    elif "XMLSchema#double" in message and "XMLSchema#float" in message:
        hint = "; no value is both an xsd:double and an xsd:float"
    because = _because(causes, name)
    charged = _charged(contradictions, causes, graphs_of, owner_of)
    if charged:
        hint += f"; charged to {', '.join(charged)}, who stated the axiom"
    error = InconsistentError(
        f"contradicts the ontology: {message}{more}{hint}{because}; nothing was stored",
        charged_to=charged,
        contradictions=[_describe(contradiction, graphs_of) for contradiction in contradictions],
        causes=[describe_cause(cause, name, graphs_of) for cause in causes],
    )
    error.clashes = tuple(contradictions)
    return error


def _charged(
    contradictions: Sequence[Any], causes: Sequence[Any], graphs_of: GraphsOf, owner_of: OwnerOf
) -> list[str]:
    """Return the robots and people without whose axioms nothing would clash."""
    forbidding = [axiom for contradiction in contradictions for axiom in contradiction.axioms]
    behind = [triple for cause in causes for triple in (*cause.statements, *cause.known)]
    charged: set[str] = set()
    for axiom in (*forbidding, *filter(_is_axiom, behind)):
        owners = [owner_of(graph) for graph in graphs_of(axiom)]
        # An axiom that the ontology states as well would clash without anybody's help.
        if None not in owners:
            charged.update(owner for owner in owners if owner)
    return sorted(charged)


def _is_axiom(triple: TripleKey) -> bool:
    return is_axiom(Quad(*triple, DEFAULT))


def _because(causes: Sequence[Any], name: Name) -> str:
    """Return the causes in words; nothing where the cause is only what clashes."""
    # A cause of a single statement repeats the contradiction itself.
    with_reasons = [cause for cause in causes if len(cause.statements) + len(cause.known) > 1]
    if not with_reasons:
        return ""
    listed = [cause_of(cause, name) for cause in with_reasons[:_LISTED]]
    if len(listed) == 1:
        assumed = with_reasons[0].known[:_SHOWN]
        beside = " and ".join(" ".join(map(name, triple)) for triple in assumed)
        return f"; cause: {listed[0]}" + (f", beside {beside}" if beside else "")
    more = f" and {len(with_reasons) - _LISTED} more" if len(with_reasons) > _LISTED else ""
    sets = " ".join(f"({number}) {text}" for number, text in enumerate(listed, 1))
    return f"; {len(with_reasons)} causes, each enough: {sets}{more}"


def cause_of(cause: Any, name: Name, limit: int = _SHOWN) -> str:
    """Return the statements of a cause in one line, at most `limit` of them."""
    shown = [" ".join(map(name, triple)) for triple in cause.statements[:limit]]
    if len(cause.statements) > limit:
        shown.append(f"{len(cause.statements) - limit} more")
    rules = "".join(f" by {rule}" for rule in cause.rules)
    return " and ".join(shown) + rules


def describe_cause(cause: Any, name: Name, graphs_of: GraphsOf) -> dict[str, Any]:
    """Return a cause as JSON-able values."""
    return {
        "message": cause_of(cause, name, _LISTED_STATEMENTS),
        "statements": _texts(cause.statements),
        "known": _texts(cause.known),
        "rules": list(cause.rules),
        "example": cause.example.message,
        "smallest": cause.is_smallest,
        "graphs": sorted({g for t in (*cause.statements, *cause.known) for g in graphs_of(t)}),
    }


def _texts(triples: Iterable[TripleKey]) -> list[list[str]]:
    return [[str(term) for term in triple] for triple in triples]


def _describe(contradiction: Any, graphs_of: GraphsOf) -> dict[str, Any]:
    """Return a contradiction as JSON-able values, with the graphs of its statements."""
    culprits: list[TripleKey] = [*contradiction.culprits()]
    return {
        "rule": contradiction.rule,
        "message": contradiction.message,
        "triples": _texts(contradiction.triples),
        "axioms": _texts(contradiction.axioms),
        "graphs": sorted({graph for triple in culprits for graph in graphs_of(triple)}),
    }
