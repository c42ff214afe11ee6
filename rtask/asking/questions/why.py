"""Addresses of what the numbers in an answer rest on: outcomes, statements, or the query."""

from __future__ import annotations

from collections.abc import Iterable
from urllib.parse import urlencode

import ontology
from rtask.asking.questions.mentions import Select
from rtask.rdf.terms import Literal, NamedNode, Term, python_value
from rtask.sparql.results import Row, Solutions

__all__ = ["why_of"]

_ROLES = {
    "robot": "^rt:performedBy",
    "object": "rt:hasGrasp",
    "grasp": "^rt:hasGrasp|^rt:executesGrasp",
}
"""Fields of the page of outcomes, and the path that what fills each has."""


def why_of(select: Select, rows: Solutions, sparql: str) -> tuple[str, ...]:
    """Return for each row the address of what its numbers rest on; "" for a row without numbers.

    Numbers about robots, objects and grasps rest on outcomes, others about something on what is
    stated about it, and those about nothing by name on the query.
    """
    counted = [_has_number(row) for row in rows]
    if not any(counted):
        return ("",) * len(counted)
    roles = _roles_of(select, [term for row in rows for term in row])
    return tuple(
        _address(row, roles, sparql) if has_number else ""
        for row, has_number in zip(rows, counted, strict=True)
    )


def _has_number(row: Row) -> bool:
    values = (None if term is None else python_value(term) for term in row)
    return any(isinstance(value, int | float) and not isinstance(value, bool) for value in values)


def _roles_of(select: Select, terms: Iterable[Term | None]) -> dict[Term, tuple[str, str]]:
    """Return the role and the IRI of what an IRI or a name stands for, if it is one."""
    given = sorted({term for term in terms if _may_name(term)}, key=str)
    if not given:
        return {}
    iris, names = (
        " ".join(str(term) for term in given if isinstance(term, kind))
        for kind in (NamedNode, Literal)
    )
    tests = " UNION ".join(
        f'{{ ?s {path} ?other BIND("{role}" AS ?role) }}' for role, path in _ROLES.items()
    )
    found = select(
        f"PREFIX rt: <{ontology.NS}>\n"
        f"SELECT DISTINCT ?term ?s ?role WHERE {{\n"
        f"  {{ VALUES ?s {{ {iris} }} BIND(?s AS ?term) }}\n"
        f"  UNION {{ VALUES ?term {{ {names} }} ?s rt:name ?term FILTER(isIRI(?s)) }}\n"
        f"  {{ {tests} }}\n}}"
    )
    meant: dict[Term, set[tuple[str, str]]] = {}
    for row in found:
        if row["term"] is not None:
            meant.setdefault(row["term"], set()).add((str(row.value("role")), str(row.value("s"))))
    return {term: next(iter(one)) for term, one in meant.items() if len(one) == 1}


def _may_name(term: Term | None) -> bool:
    is_text = isinstance(term, Literal) and isinstance(python_value(term), str)
    return isinstance(term, NamedNode) or is_text


def _address(row: Row, roles: dict[Term, tuple[str, str]], sparql: str) -> str:
    fields = dict(roles[term] for term in reversed(list(row)) if term in roles)
    if fields:
        return f"/feedback?{urlencode(sorted(fields.items()))}"
    named = [term for term in row if isinstance(term, NamedNode)]
    if named:
        return f"/resource?{urlencode({'iri': named[0].value})}"
    return f"/sparql?{urlencode({'query': sparql})}"
