"""Find out what a SPARQL server can do: write to it, read it back, and remove it again."""

from __future__ import annotations

import logging
import secrets
from collections.abc import Iterable

from pyoxigraph import (
    Literal,
    NamedNode,
    QueryResultsFormat,
    QuerySolutions,
    Triple,
    parse_query_results,
)

from rtask.errors import RtaskError
from rtask.rdf.terms import XSD, Term, stored
from rtask.remote.dialect import Abilities, Dialect
from rtask.remote.endpoints import Endpoints

__all__ = ["probe"]

_log = logging.getLogger(__name__)
_P = "<urn:rtask:probe>"
_STATEMENTS = (20_000, 5_000, 1_000, 200)
_SAMPLES: dict[str, tuple[str, ...]] = {
    "string": ("plain", 'a "quoted"\nline ☕', "", " spaces "),
    "integer": ("0", "-7", "9007199254740993"),
    "decimal": ("2.5", "-0.125", "12345678.87654321", "3"),
    "double": ("0.1", "0.30000000000000004", "0.123456789012345", "1e-7", "6.02e23", "-2.5"),
    "float": ("0.25", "1.5e10"),
    "boolean": ("true", "false"),
    "dateTime": ("2026-01-02T03:04:05Z", "2026-01-02T03:04:05.123456Z"),
    "dateTimeStamp": ("2026-01-02T03:04:05.5Z",),
    "date": ("2026-01-02",),
    "time": ("03:04:05Z",),
    "duration": ("PT1M30S", "P1Y2M"),
    "dayTimeDuration": ("PT0.5S",),
    "yearMonthDuration": ("P1Y",),
    "gYear": ("2026",),
    "gYearMonth": ("2026-01",),
    "anyURI": ("urn:x",),
    "hexBinary": ("0AFF",),
    "base64Binary": ("AAEC",),
}
_FORMS = (("boolean", "true"), ("dateTime", "2026-01-02T03:04:05.25Z"), ("double", "0.5"))
_NUMBERS = frozenset({XSD + "double", XSD + "decimal"})
_OTHERS = (
    "http://www.opengis.net/ont/geosparql#wktLiteral",
    "http://www.w3.org/1999/02/22-rdf-syntax-ns#JSON",
    "urn:rtask:probe:datatype",
)


def probe(endpoints: Endpoints) -> Abilities:
    """Find out what a server can do; what it cannot is logged, once.

    Raises
    ------
    RtaskError
        The server does not answer, or does not let this caller write.
    """
    graph = f"<urn:rtask:probe:{secrets.token_hex(6)}>"
    try:
        default = _default_graph(endpoints, graph)
        terms = _triple_terms(endpoints, graph)
        changed = _changed(endpoints, graph)
        abilities = Abilities(
            default,
            terms,
            changed - _NUMBERS,
            _is_canonical(endpoints, graph),
            not changed & _NUMBERS,
            _statements(endpoints, graph),
        )
    finally:
        endpoints.update(f"DROP SILENT GRAPH {graph}")
    if not default:
        _log.info("the default graph of %s shows others; the union is kept beside it", endpoints)
    if not terms:
        _log.warning(
            "%s stores no triple terms (RDF 1.2): statements cannot have a confidence, a validity "
            "or a source",
            endpoints,
        )
    if not abilities.exact_numbers:
        _log.warning(
            "%s shows doubles with fewer digits than it is given: they are rounded to 15", endpoints
        )
    if abilities.encoded:
        names = ", ".join(sorted(name.rpartition("#")[2] for name in abilities.encoded))
        _log.warning(
            "%s changes literals of these datatypes, so they are stored encoded and its own "
            "functions do not see their values: %s",
            endpoints,
            names,
        )
    return abilities


def _default_graph(endpoints: Endpoints, graph: str) -> bool:
    """Return whether the default graph is separate from the named ones and can be written."""
    endpoints.update(f"INSERT DATA {{ GRAPH {graph} {{ {graph} {_P} {graph} }} }}")
    if endpoints.ask(f"ASK {{ {graph} {_P} {graph} }}"):
        return False
    own = f"{graph} {_P} <urn:rtask:probe:own>"
    try:
        endpoints.update(f"INSERT DATA {{ {own} }}")
    except RtaskError:
        return False
    answer = endpoints.ask(f"ASK {{ {own} }}")
    endpoints.update(f"DELETE DATA {{ {own} }}")
    return answer


def _triple_terms(endpoints: Endpoints, graph: str) -> bool:
    text = f"{graph} <urn:rtask:probe:term> <<( {graph} {_P} {graph} )>>"
    try:
        endpoints.update(f"INSERT DATA {{ GRAPH {graph} {{ {text} }} }}")
        rows = endpoints.rows(f"SELECT ?o {{ GRAPH {graph} {{ ?s <urn:rtask:probe:term> ?o }} }}")
    except RtaskError:
        return False
    return len(rows) == 1 and isinstance(rows[0][0], Triple)


def _changed(endpoints: Endpoints, graph: str) -> frozenset[str]:
    """Return the datatypes whose literals do not come back as they were given."""
    samples = [
        stored(Literal(text, datatype=NamedNode(XSD + name)))
        for name, texts in _SAMPLES.items()
        for text in texts
    ]
    samples += [stored(Literal("text", datatype=NamedNode(name))) for name in _OTHERS]
    stored_terms = _stored_terms(endpoints, graph, samples)
    if stored_terms is None:  # one of them breaks the request
        stored_terms = set()
        for sample in samples:
            stored_terms |= _stored_terms(endpoints, graph, [sample]) or set()
    return frozenset(
        sample.datatype.value
        for sample in samples
        if sample not in stored_terms and isinstance(sample, Literal)
    )


def _is_canonical(endpoints: Endpoints, graph: str) -> bool:
    """Return whether literals come back in the form in which they were given."""
    given = [Literal(text, datatype=NamedNode(XSD + name)) for name, text in _FORMS]
    predicate = "<urn:rtask:probe:form>"
    values = " , ".join(map(str, given))
    endpoints.update(f"INSERT DATA {{ GRAPH {graph} {{ {graph} {predicate} {values} }} }}")
    answer = endpoints.query(f"SELECT ?o {{ GRAPH {graph} {{ {graph} {predicate} ?o }} }}")
    solutions = parse_query_results(answer, format=QueryResultsFormat.JSON)
    return isinstance(solutions, QuerySolutions) and {row[0] for row in solutions} == set(given)


def _stored_terms(endpoints: Endpoints, graph: str, samples: Iterable[Term]) -> set[object] | None:
    """Store some literals; return those that come back, ``None`` if they are refused.

    They are inserted as commits insert theirs, because some servers treat that differently from
    ``INSERT DATA``.
    """
    dialect = Dialect("urn:rtask:probe:")
    predicate = f"<urn:rtask:probe:{secrets.token_hex(4)}>"
    values = " , ".join(dialect.term(sample) for sample in samples)
    try:
        endpoints.update(
            f"INSERT {{ GRAPH {graph} {{ {graph} {predicate} {values} }} }} "
            f"WHERE {{ GRAPH {graph} {{ {graph} {_P} {graph} }} }}"
        )
        rows = endpoints.rows(f"SELECT ?o {{ GRAPH {graph} {{ {graph} {predicate} ?o }} }}")
    except RtaskError:
        return None
    return {row[0] for row in rows}


def _statements(endpoints: Endpoints, graph: str) -> int:
    """Return how many statements a request of the kind of a commit may hold."""
    for count in _STATEMENTS:
        lines = " . ".join(f"<urn:rtask:probe:{n}> {_P} {n}" for n in range(count))
        condition = f"GRAPH {graph} {{ {graph} {_P} <urn:rtask:probe:never> }}"
        try:
            endpoints.update(
                f"DELETE {{ {condition} }} INSERT {{ GRAPH {graph} {{ {lines} }} }} "
                f"WHERE {{ {condition} }}"
            )
        except RtaskError:
            continue
        return count
    return _STATEMENTS[-1]
