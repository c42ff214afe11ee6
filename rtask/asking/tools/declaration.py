"""Declaration of a tool for agents: one decorator on its handler.

Name, sentence, examples, the classes of request and answer and the effect on the graph stand in one
place; the schemas, the hints and what the server does with a call follow from them.
"""

from __future__ import annotations

import json
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

from pydantic import BaseModel

from rtask.asking.check.checker import checker_of
from rtask.asking.terms import Reader, reader_of
from rtask.asking.tools.values import Terms
from rtask.errors import UnsupportedError, UsageError
from rtask.rdf.terms import RDF_TYPE, XSD, Literal, NamedNode, TripleKey, iri, stored
from rtask.wire.effect import Effect, Source
from rtask.wire.message import Answer, Message

if TYPE_CHECKING:
    from rtask.kb.commit.access import Access
    from rtask.kb.core import GraphCore

__all__ = ["Asked", "Engine", "Operation", "Paged", "PagedAnswer", "Tool", "Work", "rest", "tool"]

_PLAIN_NUMBERS = {XSD + "integer", XSD + "decimal"}
_KEPT = ("type", "required", "minimum", "maximum", "maxItems")
Q = TypeVar("Q", bound=Message)
A = TypeVar("A", bound=Answer)


class Work(Protocol):
    """A call under way, as its caller sees it."""

    @property
    def is_stopped(self) -> bool:
        """Whether its caller gave it up."""

    def on_stop(self, stop: Callable[[], None]) -> None:
        """Register how to stop it."""

    def report(self, share: float, words: str) -> None:
        """Say how much is done, 0..1."""


class Operation(Protocol):
    """What is declared of an operation of the engine."""

    @property
    def scope(self) -> str:
        """Scope that a caller needs."""

    @property
    def effect(self) -> Effect:
        """Its effect on the graph."""


class Engine(Protocol):
    """Operations on the graph, as the engine offers them."""

    @property
    def operations(self) -> Mapping[str, Any]:
        """By name."""

    def call(self, name: str, args: dict[str, Any], access: Access) -> Any:
        """Carry out an operation with the rights of a caller."""


@dataclass(frozen=True)
class Asked:
    """What a handler works with.

    Parameters
    ----------
    kb
        The graph.
    access
        Rights of the caller.
    engine
        Operations; None where there are none.
    site
        Beginning of the addresses of proofs.
    work
        The call.
    timeout_s
        Time limit of a query.
    """

    kb: GraphCore
    access: Access
    engine: Engine | None
    site: str
    work: Work
    timeout_s: float
    terms: Terms = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "terms", Terms(self.kb, self.site))

    @property
    def reader(self) -> Reader:
        """Reads terms in any form that a tool, a command or a page prints."""
        return reader_of(self.kb)

    def resource(self, text: str) -> NamedNode:
        """Return what a text names: a term in any form, or a name without quotes.

        Raises
        ------
        RtaskError
            It names nothing, or several things.
        """
        reader = self.reader
        try:
            return reader.resource(text)
        except UsageError as error:
            named = [iri(name) for name in reader.named(text.strip().strip("'\""))]
            if not named:
                raise error
            individuals = [part for part in named if not _is_term(self.kb, part)]
            if len(individuals) == 1 or len(named) == 1:
                return (individuals or named)[0]
            return reader.thing(text.strip().strip("'\""))

    def statement(self, subject: str, predicate: str, value: str) -> TripleKey:
        """Return a statement in any form that a tool prints.

        A plain number has the datatype that the property asks for, for tools print all numbers
        alike.
        """
        triple = self.reader.statement(subject, predicate, value)
        number = triple[2]
        if not (isinstance(number, Literal) and number.datatype.value in _PLAIN_NUMBERS):
            return triple
        declared = checker_of(self.kb).vocabulary.properties.get(triple[1].value)
        datatypes = declared.datatypes if declared is not None else set()
        if len(datatypes) != 1 or number.datatype.value in datatypes:
            return triple
        fitting = Literal(number.value, datatype=NamedNode(min(datatypes)))
        return triple[0], triple[1], stored(fitting)

    def operate(self, name: str, **args: Any) -> Any:
        """Carry out an operation of the engine.

        Raises
        ------
        UnsupportedError
            There is no engine.
        """
        if self.engine is None or name not in self.engine.operations:
            raise UnsupportedError("this graph is served without the engine")
        return self.engine.call(name, args, self.access)


def _is_term(kb: GraphCore, name: NamedNode) -> bool:
    """Whether something is a class or property of an ontology."""
    return any(kb.catalogue.is_ontology(quad.graph_name) for quad in kb.match(name, RDF_TYPE))


class Paged(Message):
    """A request whose answer may be longer than an answer of a tool."""

    offset: int = 0
    """from more.offset"""


class More(Answer):
    """How to get the rest of a list: call again with this offset.

    Schemas of answers say only that it is there: agents are told what to do with it where they do
    it, at ``offset`` of the request, and every byte of the list of tools is read by each agent.
    """

    offset: int
    left: int
    """at least so many"""


class PagedAnswer(Answer):
    """An answer with one list that is cut to the size of an answer."""

    commit: int
    more: More = More(offset=0, left=0)


def rest(offset: int, left: int) -> dict[str, Any]:
    """Return the member that tells how to get ``left`` or more entries, which were left out.

    >>> rest(50, 3), rest(50, 0)
    ({'more': {'offset': 50, 'left': 3}}, {})
    """
    return {"more": {"offset": offset, "left": left}} if left > 0 else {}


@dataclass(frozen=True)
class Tool(Generic[Q, A]):
    """One tool.

    Parameters
    ----------
    name
        As agents guess it.
    sentence
        What it does.
    examples
        Arguments of two calls.
    request, answer
        Their declarations.
    handler
        Takes what it works with and the checked request.
    entries
        Names of the lists of which one is set, and is cut to size.
    scope, effect
        What a caller needs, and what a call does to the graph.
    operation
        Name of the operation that it carries out, whose scope and effect it has.
    source
        What its answer is made from.
    """

    name: str
    sentence: str
    examples: tuple[Mapping[str, Any], ...]
    request: type[Q]
    answer: type[A]
    handler: Callable[[Asked, Q], A]
    entries: tuple[str, ...] = ()
    scope: str = "read"
    effect: Effect = "reads"
    operation: str = ""
    source: Source = "graph"

    def description(self) -> str:
        """Return the sentence and the examples."""
        texts = (json.dumps(part, ensure_ascii=False) for part in self.examples)
        return f"{self.sentence} Examples: {' or '.join(texts)}"

    def listed(self, effect: Effect) -> dict[str, Any]:
        """Return the tool as lists of tools show it."""
        return {
            "name": self.name,
            "description": self.description(),
            "inputSchema": schema_of(self.request),
            "outputSchema": schema_of(self.answer),
            "annotations": {"readOnlyHint": effect == "reads"},
        }


def tool(
    sentence: str,
    *examples: Mapping[str, Any],
    entries: tuple[str, ...] = (),
    scope: str = "read",
    effect: Effect = "reads",
    operation: str = "",
    source: Source = "graph",
) -> Callable[[Callable[[Asked, Q], A]], Tool[Q, A]]:
    """Declare a handler ``(asked, request) -> answer`` as a tool of its name."""

    def declare(handler: Callable[[Asked, Q], A]) -> Tool[Q, A]:
        hints = typing.get_type_hints(handler)
        request, answer = (hints[name] for name in ("request", "return"))
        name = getattr(handler, "__name__", "")
        return Tool(
            name, sentence, examples, request, answer, handler, entries, scope, effect, operation,
            source,
        )  # fmt: skip

    return declare


def schema_of(model: type[BaseModel]) -> dict[str, Any]:
    """Return the JSON Schema of a message in few bytes.

    Fields of requests have their summaries; parts of answers are objects with required members.

    >>> schema_of(Paged)["properties"]["offset"]
    {'type': 'integer', 'description': 'from more.offset'}
    """
    is_request = issubclass(model, Message)
    whole = model.model_json_schema(mode="validation" if is_request else "serialization")
    parts = {name: _part(part) for name, part in whole.get("$defs", {}).items()}
    if More.__name__ in parts:
        parts[More.__name__] = {"type": "object"}
    members = {name: _brief(part, parts, is_request) for name, part in whole["properties"].items()}
    schema = {"type": "object", "properties": members, "required": whole.get("required", [])}
    return schema if schema["required"] else {"type": "object", "properties": members}


def _part(schema: dict[str, Any]) -> dict[str, Any]:
    required = schema.get("required", [])
    return {"type": "object", "required": required} if required else {"type": "object"}


def _brief(schema: Any, parts: Mapping[str, Any], is_request: bool) -> dict[str, Any]:
    """Return the schema of a field without titles, null and what is not needed to check it."""
    kinds = [part for part in schema.get("anyOf", ()) if part != {"type": "null"}]
    may_be_null = len(kinds) < len(schema.get("anyOf", ()))
    if len(kinds) == 1:
        schema = {**{key: part for key, part in schema.items() if key != "anyOf"}, **kinds[0]}
    if "$ref" in schema:
        schema = parts[schema["$ref"].rpartition("/")[2]]
    brief = {key: schema[key] for key in _KEPT if key in schema}
    if "items" in schema:
        brief["items"] = _brief(schema["items"], parts, is_request)
    if is_request:
        if "description" in schema:
            brief["description"] = schema["description"]
        # Of a member that may be left out, 0 and nothing go without saying.
        if schema.get("default"):
            brief["default"] = schema["default"]
    elif may_be_null and "type" in brief:
        brief["type"] = [brief["type"], "null"]
    return brief
