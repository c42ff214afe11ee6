"""Addresses of what a number rests on: outcomes with their robots, or the statements about it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING
from urllib.parse import quote

from rtask.rdf.namespaces import RT
from rtask.rdf.terms import BlankNode, Literal, NamedNode, Term, python_value

if TYPE_CHECKING:
    from rtask.asking.tools.declaration import Asked
    from rtask.asking.tools.values import Value

__all__ = ["outcomes_page", "statements_page", "with_evidence"]

_ROLES = ("robot", "object", "grasp")
"""Fields of the page of outcomes, in the order in which they narrow it."""


def outcomes_page(asked: Asked, **about: NamedNode) -> str:
    """Return the address of the outcomes of a robot, an object or a grasp, or of several."""
    fields = (f"{role}={_quoted(asked, about[role])}" for role in _ROLES if role in about)
    return f"{asked.site}/feedback?{'&'.join(fields)}"


def statements_page(asked: Asked, subject: Term) -> str:
    """Return the address of what is stated about something; empty for an anonymous one."""
    if not isinstance(subject, NamedNode):
        return ""
    return f"{asked.site}/resource?iri={_quoted(asked, subject)}"


def _quoted(asked: Asked, term: NamedNode) -> str:
    return quote(asked.terms.short(term), safe=":/")


def with_evidence(
    asked: Asked, terms: Sequence[Sequence[Term | None]], rows: Sequence[Sequence[Value | None]]
) -> list[list[Value | None]]:
    """Return rows of a query whose numbers name the page of what they rest on.

    Numbers in a row with robots, objects or grasps rest on their outcomes; other numbers on what is
    stated about the first thing in the row. Those of a row that names nothing rest on the query
    alone.
    """
    roles: dict[Term, str] = {}
    result = []
    for given, values in zip(terms, rows, strict=True):
        why = _page_of(asked, given, roles) if any(_is_number(value) for value in values) else ""
        result.append([_explained(value, why) for value in values])
    return result


def _is_number(value: Value | None) -> bool:
    return value is not None and value.type == "number"


def _explained(value: Value | None, why: str) -> Value | None:
    if value is None or not why or not _is_number(value):
        return value
    return value.model_copy(update={"why": why})


def _page_of(asked: Asked, terms: Iterable[Term | None], roles: dict[Term, str]) -> str:
    about: dict[str, NamedNode] = {}
    first: NamedNode | None = None
    for term in terms:
        subject = _named(asked, term)
        if subject is None:
            continue
        if subject not in roles:
            roles[subject] = _role(asked, subject)
        if roles[subject]:
            about.setdefault(roles[subject], subject)
        first = first or subject
    if about:
        return outcomes_page(asked, **about)
    return "" if first is None else statements_page(asked, first)


def _named(asked: Asked, term: Term | None) -> NamedNode | None:
    """Return what a term is or names; None for what names nothing, or several things."""
    if isinstance(term, NamedNode):
        return term
    if not isinstance(term, Literal) or not isinstance(python_value(term), str):
        return None
    named = {quad.subject for quad in asked.kb.match(None, RT.name, term)}
    (subject,) = named if len(named) == 1 else (BlankNode(),)
    return subject if isinstance(subject, NamedNode) else None


def _role(asked: Asked, term: NamedNode) -> str:
    """Return as what something takes part in attempts; empty for what does not."""
    patterns = {
        "robot": ((None, RT.performedBy, term),),
        "object": ((term, RT.hasGrasp, None),),
        "grasp": ((None, RT.executesGrasp, term), (None, RT.hasGrasp, term)),
    }
    quads = asked.kb.store.quads_for_pattern
    for role, ways in patterns.items():
        if any(next(iter(quads(*way, None)), None) is not None for way in ways):
            return role
    return ""
