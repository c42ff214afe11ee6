"""Addresses of what the numbers in an answer rest on: outcomes, statements, or the query."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from urllib.parse import urlencode

import ontology
from rtask.asking.questions.mentions import Select
from rtask.rdf.terms import Literal, NamedNode, Term, python_value
from rtask.sparql.results import Row, Solutions

__all__ = ["why_of", "why_of_attempts", "why_of_facts"]

_ROLES = {
    "robot": "^rt:performedBy",
    "object": "rt:hasGrasp",
    "grasp": "^rt:hasGrasp|^rt:executesGrasp",
}
"""Fields of the page of outcomes, and the path that what fills each has."""


def why_of(
    select: Select, rows: Solutions, sparql: str, asked: Mapping[str, str] = MappingProxyType({})
) -> tuple[str, ...]:
    """Return for each row the address of what its numbers rest on; "" for a row without numbers.

    Numbers about robots, objects and grasps rest on outcomes, others about something on what is
    stated about it, and those about nothing by name on the query.

    Parameters
    ----------
    asked
        IRI of the one object or robot to which the question restricts all rows, by role: without
        it, the outcomes shown would be more than those counted.
    """
    counted = [_has_number(row) for row in rows]
    if not any(counted):
        return ("",) * len(counted)
    roles = _roles_of(select, [term for row in rows for term in row])
    return tuple(
        _address(row, roles, sparql, asked) if has_number else ""
        for row, has_number in zip(rows, counted, strict=True)
    )


def why_of_attempts(objects: Sequence[str], robots: Sequence[str]) -> tuple[str, ...]:
    """Return the address of the outcomes at a thing, by a robot or both; none for several.

    Parameters
    ----------
    objects, robots
        IRIs as SPARQL writes them.
    """
    if len(objects) > 1 or len(robots) > 1 or not (objects or robots):
        return ()
    fields = {"object": objects, "robot": robots}
    given = {name: iris[0].strip("<>") for name, iris in fields.items() if iris}
    return (f"/feedback?{urlencode(given)}",)


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


def why_of_facts(rows: Solutions, thing: str) -> tuple[str, ...]:
    """Return for each fact about a thing the address of its statements; "" for one without number.

    Parameters
    ----------
    thing
        Its IRI.
    """
    address = f"/resource?{urlencode({'iri': thing})}"
    return tuple(address if _has_number(row) else "" for row in rows)


def _address(
    row: Row, roles: dict[Term, tuple[str, str]], sparql: str, asked: Mapping[str, str]
) -> str:
    fields = dict(roles[term] for term in reversed(list(row)) if term in roles)
    if fields:
        fields = {role: iri for role, iri in asked.items() if role in _ROLES} | fields
        return f"/feedback?{urlencode(sorted(fields.items()))}"
    named = [term for term in row if isinstance(term, NamedNode)]
    if named:
        return f"/resource?{urlencode({'iri': named[0].value})}"
    return f"/sparql?{urlencode({'query': sparql})}"
