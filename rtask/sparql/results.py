"""Results of queries, complete in memory and independent of the store.

A lazy result of the store must be consumed in the thread that created it, or the process crashes.
Results are therefore always complete when they leave the knowledge base.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NoReturn, overload

from pyoxigraph import (
    QueryBoolean,
    QueryResultsFormat,
    QuerySolutions,
    RdfFormat,
    Triple,
    parse,
    parse_query_results,
    serialize,
)

from rtask.errors import UsageError
from rtask.rdf.terms import Term, python_value
from rtask.rdf.xml_text import XmlWriter, writable

__all__ = ["Row", "Solutions", "Triples", "read_answer"]


class Row:
    """One solution; indexed by variable name or position.

    Examples
    --------
    >>> from rtask.rdf.terms import iri
    >>> row = Row({"x": 0, "y": 1}, (iri("urn:mug"), None))
    >>> row["x"], row[0] == row["x"], row["y"], row.value("x")
    (<NamedNode value=urn:mug>, True, None, 'urn:mug')
    """

    __slots__ = ("_positions", "_terms")

    def __init__(self, positions: Mapping[str, int], terms: tuple[Term | None, ...]) -> None:
        self._positions = positions
        self._terms = terms

    def __getitem__(self, key: str | int) -> Term | None:
        if isinstance(key, int):
            return self._terms[key]
        try:
            return self._terms[self._positions[key.lstrip("?$")]]
        except KeyError:
            variables = ", ".join(self._positions)
            raise UsageError(f"no variable {key!r} in this result; it has {variables}") from None

    if not TYPE_CHECKING:  # type checkers name attributes that are not there themselves

        def __getattr__(self, name: str) -> NoReturn:
            """Refuse an attribute; other libraries' rows have their variables as such."""
            has = not name.startswith("_") and name in self._positions
            hint = f"; the term of ?{name} is row[{name!r}]" if has else ""
            raise AttributeError(f"a row has no attribute {name!r}{hint}")

    def __iter__(self) -> Iterator[Term | None]:
        return iter(self._terms)

    def __len__(self) -> int:
        return len(self._terms)

    def value(self, key: str | int) -> object:
        """Return a term as a Python value; see :func:`rtask.rdf.terms.python_value`."""
        return python_value(self[key])

    def to_dict(self) -> dict[str, object]:
        """Return the row as JSON-able Python values, unbound variables as ``None``."""
        return {name: python_value(self._terms[at]) for name, at in self._positions.items()}

    def __repr__(self) -> str:
        pairs = ", ".join(f"{name}={self._terms[at]}" for name, at in self._positions.items())
        return f"Row({pairs})"


class Solutions(Sequence[Row]):
    """The rows of a SELECT.

    Parameters
    ----------
    variables
        Names in the order of the projection, without ``?``.
    rows
        One tuple of terms for each row, ``None`` where unbound.
    """

    def __init__(self, variables: Sequence[str], rows: Sequence[tuple[Term | None, ...]]) -> None:
        self.variables = tuple(variables)
        self._rows = rows
        self._positions = {name: at for at, name in enumerate(self.variables)}

    @overload
    def __getitem__(self, index: int) -> Row: ...
    @overload
    def __getitem__(self, index: slice) -> Solutions: ...
    def __getitem__(self, index: int | slice) -> Row | Solutions:
        if isinstance(index, slice):
            return Solutions(self.variables, self._rows[index])
        return Row(self._positions, self._rows[index])

    def __iter__(self) -> Iterator[Row]:
        return (Row(self._positions, terms) for terms in self._rows)

    def __len__(self) -> int:
        return len(self._rows)

    def tuples(self) -> Sequence[tuple[Term | None, ...]]:
        """Return the rows as plain tuples in the order of the variables, for large answers."""
        return self._rows

    def to_dicts(self) -> list[dict[str, object]]:
        """Return the rows as dictionaries of JSON-able Python values."""
        return [row.to_dict() for row in self]

    def __repr__(self) -> str:
        return f"<Solutions {len(self)} rows of {', '.join(self.variables)}>"


@dataclass(frozen=True)
class Triples(Sequence[Triple]):
    """The triples of a CONSTRUCT or DESCRIBE."""

    triples: tuple[Triple, ...]

    @overload
    def __getitem__(self, index: int) -> Triple: ...
    @overload
    def __getitem__(self, index: slice) -> Triples: ...
    def __getitem__(self, index: int | slice) -> Triple | Triples:
        if isinstance(index, slice):
            return Triples(self.triples[index])
        return self.triples[index]

    def __len__(self) -> int:
        return len(self.triples)

    def serialize(self, format: RdfFormat = RdfFormat.TURTLE) -> bytes:
        """Return the triples as bytes of an RDF format."""
        if format == RdfFormat.RDF_XML:
            return _rdf_xml(self.triples)
        written = serialize(self.triples, format=format)
        assert written is not None
        return written


def _rdf_xml(triples: Iterable[Triple]) -> bytes:
    sink = io.BytesIO()
    xml: Any = XmlWriter(sink)
    try:
        serialize(writable(triples), xml, format=RdfFormat.RDF_XML)
    except ValueError as error:
        raise UsageError(str(error)) from error
    xml.finish()
    return sink.getvalue()


def read_answer(kind: str, data: bytes) -> Solutions | bool | Triples:
    """Parse an answer in SPARQL results JSON or N-Triples."""
    if kind == "triples":
        quads = parse(data, format=RdfFormat.N_TRIPLES)
        return Triples(tuple(quad.triple for quad in quads))
    answer = parse_query_results(data, format=QueryResultsFormat.JSON)
    if isinstance(answer, QueryBoolean):
        return bool(answer)
    assert isinstance(answer, QuerySolutions)
    names = [variable.value for variable in answer.variables]
    return Solutions(names, [tuple(row) for row in answer])
