"""Values for the variables of a query."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

from rtask.errors import UsageError
from rtask.rdf.terms import Value, is_ground, object_term, written
from rtask.sparql.lexer import body_start, find_block_end, tokenise

__all__ = ["Bindings", "bind"]

Bindings: TypeAlias = Mapping[str, "Value | Sequence[Value]"]


def bind(text: str, bindings: Bindings) -> str:
    """Bind variables of a query by ``VALUES`` clauses at the start of its WHERE.

    Parameters
    ----------
    bindings
        Mapping from variable name to a term or value, or to a list of them.

    Examples
    --------
    >>> from rtask.rdf.terms import iri
    >>> bind("SELECT * { ?s ?p ?o }", {"s": iri("urn:mug")})
    'SELECT * { VALUES ?s { <urn:mug> } ?s ?p ?o }'
    """
    if not bindings:
        return text
    tokens = tokenise(text)
    start = body_start(tokens)
    at = next((i for i in range(start, len(tokens)) if tokens[i].is_mark("{")), None)
    if at is None:
        raise UsageError("bindings need a query with a WHERE block")
    if tokens[start].is_word("CONSTRUCT") and at == start + 1:
        end = find_block_end(tokens, at)
        at = next((i for i in range(end, len(tokens)) if tokens[i].is_mark("{")), None)
        if at is None:
            raise UsageError("bindings need a query with a WHERE block")
    clauses = "".join(
        f" VALUES ?{name.lstrip('?$')} {{ {_values(value)} }}" for name, value in bindings.items()
    )
    cut = tokens[at].end
    return text[:cut] + clauses + text[cut:]


def _values(value: Value | Sequence[Value]) -> str:
    listed = isinstance(value, Sequence) and not isinstance(value, str)
    return " ".join(_value(v) for v in (value if listed else [value]))  # type: ignore[union-attr,arg-type]


def _value(value: Value) -> str:
    term = object_term(value)
    if not is_ground(term):
        raise UsageError("a blank node cannot be bound in a query; give its IRI")
    return written(term)
