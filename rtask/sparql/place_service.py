"""``SERVICE <urn:rtask:place>``: where things are in relation to each other, as a pattern.

A block asks for one relation, and is replaced by a ``VALUES`` clause with the pairs for which it
holds now or at an instant::

    SERVICE <urn:rtask:place> { ?thing rtf:near ?other ; rtf:within 0.3 ; rtf:distance ?metres }

Both sides are a variable or an IRI. The relations are ``rtf:near``, ``rtf:above``, ``rtf:inside``,
``rtf:reachedBy`` and ``rtf:poseIn``; the answers are computed outside of the store, in bounds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime

from pyoxigraph import Literal, NamedNode

import ontology
from rtask.rdf.terms import written
from rtask.sparql.service_blocks import block_refusal, replace_blocks, string_value
from rtask.sparql.templates import resolve
from rtask.sparql.tokens import Token

__all__ = ["PLACE_SERVICE", "RELATIONS", "PlaceQuestion", "PlaceRow", "with_places"]

PLACE_SERVICE = "urn:rtask:place"
RELATIONS: Mapping[str, tuple[str, ...]] = {
    "near": ("distance", "chance"),
    "above": ("distance", "chance"),
    "inside": ("chance",),
    "reachedBy": ("distance", "chance"),
    "poseIn": ("x", "y", "z", "chance"),
}
"""Relations, and the numbers that each can answer."""
_FORM = "expected ?thing rtf:near ?other ; rtf:within 0.5 ; rtf:distance ?metres"
_SIDES = ("iri", "name", "variable")


@dataclass(frozen=True)
class PlaceQuestion:
    """What one block asks.

    Parameters
    ----------
    relation
        One of :data:`RELATIONS`.
    subject, other
        IRIs of the two sides; None for a variable.
    within_m
        Greatest distance, m; None if none is given.
    at_s
        Unix time, s; None for now.
    """

    relation: str
    subject: str | None
    other: str | None
    within_m: float | None = None
    at_s: float | None = None


@dataclass(frozen=True)
class PlaceRow:
    """Two sides between which the relation holds, and what is known of it in numbers."""

    subject: str
    other: str
    numbers: Mapping[str, float] = field(default_factory=dict)


PlaceSearch = Callable[[PlaceQuestion], Sequence[PlaceRow]]


def with_places(text: str, search: PlaceSearch) -> str:
    """Return a query with each block of the place service replaced by its pairs.

    Raises
    ------
    QuerySyntaxError
        A block contains anything else.
    """
    return replace_blocks(
        text, PLACE_SERVICE, lambda prologue, tokens: _Block(text, prologue, tokens).values(search)
    )


class _Block:
    """One block of the place service."""

    def __init__(self, text: str, prologue: str, tokens: list[Token]) -> None:
        self._text, self._prologue = text, prologue
        self._relation = ""
        self._sides: list[Token] = []
        self._outputs: dict[str, Token] = {}
        self._within: float | None = None
        self._at: float | None = None
        # A final point is allowed behind the last pattern of a group (SPARQL 1.1 Query, 5.1).
        while tokens and tokens[-1].is_mark("."):
            tokens = tokens[:-1]
        if not tokens or tokens[0].kind not in _SIDES:
            raise self._refusal(tokens, _FORM)
        self._sides.append(tokens[0])
        rest = tokens[1:]
        while rest:
            rest = self._property(rest)
        if not self._relation:
            raise self._refusal(tokens, f"no relation: one of {self._names(RELATIONS)}")
        self._check(tokens)

    def values(self, search: PlaceSearch) -> str:
        """Return the pattern that takes the block's place."""
        subject, other = (
            None if side.kind == "variable" else self._iri(side) for side in self._sides
        )
        question = PlaceQuestion(self._relation, subject, other, self._within, self._at)
        rows = search(question)
        columns = [(self._sides[0], "subject"), (self._sides[1], "other")]
        columns = [(token, name) for token, name in columns if token.kind == "variable"]
        columns += [(token, name) for name, token in self._outputs.items()]
        if not columns:
            # Nothing is asked for but whether it holds: a pattern that matches once, or never.
            return "{}" if rows else "FILTER(false)"
        heads = " ".join(token.text for token, _ in columns)
        lines = " ".join(f"({' '.join(_cell(row, n) for _, n in columns)})" for row in rows)
        return f"VALUES ({heads}) {{ {lines} }}"

    def _property(self, tokens: list[Token]) -> list[Token]:
        """Read one property and its value; return the tokens behind them."""
        name = self._local(tokens[0])
        if len(tokens) < 2:
            raise self._refusal(tokens, f"rtf:{name} has no value")
        value, rest = tokens[1], tokens[2:]
        # The datatype of a time is stepped over: its text alone says which one it is.
        if value.kind == "string" and len(rest) > 1 and rest[0].is_mark("^^"):
            rest = rest[2:]
        if rest and not rest[0].is_mark(";"):
            raise self._refusal(rest, "expected ';'")
        if name in RELATIONS and not self._relation and value.kind in _SIDES:
            self._relation = name
            self._sides.append(value)
        elif name == "within" and value.kind == "number" and float(value.text) > 0:
            self._within = float(value.text)
        elif name == "at" and value.kind == "string":
            self._at = self._time(value)
        elif value.kind == "variable" and any(
            name in properties for properties in RELATIONS.values()
        ):
            self._outputs[name] = value
        else:
            raise self._refusal(tokens, f"rtf:{name} {value.text} cannot be asked; {_FORM}")
        return rest[1:]

    def _check(self, tokens: list[Token]) -> None:
        able = RELATIONS[self._relation]
        unable = [name for name in self._outputs if name not in able]
        if unable:
            message = f"rtf:{self._relation} answers {self._names(able)}, not rtf:{unable[0]}"
            raise self._refusal(tokens, message)
        if self._relation == "poseIn" and self._sides[1].kind == "variable":
            raise self._refusal(tokens, "rtf:poseIn needs the IRI of a frame, robot or thing")
        named = [*self._sides, *self._outputs.values()]
        variables = [token.text for token in named if token.kind == "variable"]
        # VALUES names each column once; as a join it would need both to be equal, which is not what
        # was meant.
        if len(set(variables)) < len(variables):
            raise self._refusal(tokens, "a variable stands for two different values")

    def _local(self, token: Token) -> str:
        name = self._iri(token) if token.kind in ("iri", "name") else ""
        if not name.startswith(ontology.FUNCTIONS):
            raise self._refusal([token], f"{token.text} is no place function; {_FORM}")
        return name.removeprefix(ontology.FUNCTIONS)

    def _iri(self, token: Token) -> str:
        return resolve(token.text, self._prologue, None).value

    def _time(self, token: Token) -> float:
        try:
            moment = datetime.fromisoformat(string_value(token))
        except ValueError as error:
            raise self._refusal([token], f"rtf:at: {error}") from error
        # Times without a zone are UTC here, as everywhere in the graph.
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()

    def _refusal(self, tokens: list[Token], message: str) -> Exception:
        return block_refusal(self._text, PLACE_SERVICE, tokens, message)

    def _names(self, names: Sequence[str] | Mapping[str, object]) -> str:
        return ", ".join(f"rtf:{name}" for name in names)


def _cell(row: PlaceRow, name: str) -> str:
    if name in ("subject", "other"):
        return written(NamedNode(row.subject if name == "subject" else row.other))
    number = row.numbers.get(name)
    return "UNDEF" if number is None else written(Literal(float(number)))
