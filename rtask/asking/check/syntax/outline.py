"""Outline of a query: its groups, triple patterns and variables, each with its place in the text.

Read from the tokens in one pass, for texts that the store's parser accepts. Paths are split into
edges: a sequence introduces variables of its own, and an alternative gives an edge several
predicates.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal as Choice
from typing import TypeAlias

from rtask.rdf.terms import RDF_TYPE

__all__ = ["Edge", "Group", "Node", "Outline", "Step"]

Kind: TypeAlias = Choice["variable", "iri", "literal", "blank"]
Role: TypeAlias = Choice["plain", "optional", "union", "minus", "exists", "service"]


@dataclass(slots=True)
class Node:
    """A term of a pattern.

    Attributes
    ----------
    kind
        Of term.
    value
        IRI, name of the variable, or text of the literal.
    start, end
        Place in the text; equal for what the text does not name.
    datatype
        IRI of a literal's datatype.
    alias
        What an expression calls a variable whose own name says nothing: ``(MIN(?w) AS ?width)``.
    """

    kind: Kind
    value: str
    start: int
    end: int
    datatype: str = ""
    alias: str = ""

    @property
    def name(self) -> str:
        """What says of a variable what it stands for."""
        return self.alias or self.value


@dataclass(slots=True)
class Step:
    """A predicate of an edge; a path may walk it against its direction."""

    node: Node
    is_inverse: bool = False


@dataclass(slots=True)
class Edge:
    """A triple pattern, or a step of a path.

    Attributes
    ----------
    subject, object
        Its ends.
    steps
        Its predicates: one, or the alternatives of a path; none for a variable or a complex path.
    is_loose
        Whether a path may be of length zero, so that nothing is known of its ends.
    is_path
        Whether it is a part of a longer path, or repeated.
    repeats
        Whether a path may walk it more than once.
    predicate
        Variable that stands for its predicate.
    start, end
        Place of the pattern in the text, its object included.
    """

    subject: Node
    steps: list[Step]
    object: Node
    start: int
    end: int
    is_loose: bool = False
    is_path: bool = False
    repeats: bool = False
    predicate: Node | None = None
    _signature: str = field(default="", init=False, repr=False, compare=False)
    _pattern: str = field(default="", init=False, repr=False, compare=False)

    def mentions(self, variable: str) -> bool:
        """Return whether a variable is one of its ends."""
        return any(end.kind == "variable" and end.value == variable for end in self.ends)

    @property
    def signature(self) -> str:
        """What it matches in any graph, whatever its variables are called."""
        if not self._signature:
            ends = (
                "?" if node.kind == "variable" else f"{node.kind} {node.value} {node.datatype}"
                for node in self.ends
            )
            steps = (f"{'^' * step.is_inverse}{step.node.value}" for step in self.steps)
            self._signature = "\n".join((*ends, *steps))
        return self._signature

    @property
    def pattern(self) -> str:
        """What it says, the names of its variables included."""
        if not self._pattern:
            names = " ".join(
                f"{end.value} {end.alias}" for end in self.ends if end.kind == "variable"
            )
            path = f"{self.is_loose:d}{self.is_path:d}{self.repeats:d}"
            self._pattern = f"{names} {path}\n{self.signature}"
        return self._pattern

    @property
    def ends(self) -> tuple[Node, Node]:
        """Subject and object."""
        return self.subject, self.object

    @property
    def variables(self) -> list[Node]:
        """Variables at its ends, and the one for its predicate."""
        ends = [end for end in self.ends if end.kind == "variable"]
        return ends if self.predicate is None else [*ends, self.predicate]


@dataclass(slots=True)
class Group:
    """A group of patterns and what stands in it.

    Attributes
    ----------
    role
        How it is joined with the group around it.
    edges
        Its triple patterns.
    children
        Groups inside it, those of EXISTS filters too.
    filters
        The variables of each FILTER.
    binds
        Variable of each BIND, with those of its expression.
    values
        Variables of VALUES, with the terms of their columns.
    equal
        Variables that a FILTER or BIND makes equal to one of some things.
    compared
        Variables that expressions read as values, each with what they must be there: ``number``,
        ``text``, ``moment``, ``quantity`` (a number or a moment), ``ordered`` or ``literal``.
    graph
        Term after GRAPH, for a group of that kind.
    defined
        Variables that the sub-select in it defines, of what is inside.
    """

    role: Role
    start: int
    end: int = 0
    edges: list[Edge] = field(default_factory=list)
    children: list[Group] = field(default_factory=list)
    filters: list[list[Node]] = field(default_factory=list)
    binds: list[tuple[Node, list[Node]]] = field(default_factory=list)
    values: list[tuple[Node, list[Node]]] = field(default_factory=list)
    equal: list[tuple[Node, list[Node]]] = field(default_factory=list)
    compared: list[tuple[Node, str]] = field(default_factory=list)
    graph: Node | None = None
    defined: list[Node] = field(default_factory=list)

    def walk(self) -> Iterator[Group]:
        """Yield this group and all inside it."""
        yield self
        for child in self.children:
            yield from child.walk()


@dataclass(slots=True)
class Outline:
    """A whole query.

    Attributes
    ----------
    form
        ``SELECT``, ``ASK``, ``CONSTRUCT`` or ``DESCRIBE``.
    body
        The WHERE clause.
    projected
        Plain variables of the SELECT clause.
    selects_all
        Whether the clause is ``*``.
    defined
        Variables that expressions of the SELECT clause define.
    mentioned
        Variables of expressions, GROUP BY, HAVING and ORDER BY, and of a template.
    grouped
        Variables of GROUP BY; None without one.
    iris
        Every IRI outside triple patterns, such as in expressions.
    prefixes
        Namespaces by prefix.
    inner
        Outlines of its sub-selects.
    aliases
        Variables that an expression gives another name, each with the function (empty if there is
        none) and that name.
    """

    form: str
    body: Group
    projected: list[Node] = field(default_factory=list)
    selects_all: bool = False
    defined: list[Node] = field(default_factory=list)
    mentioned: list[Node] = field(default_factory=list)
    grouped: list[Node] | None = None
    iris: list[Node] = field(default_factory=list)
    prefixes: dict[str, str] = field(default_factory=dict)
    inner: list[Outline] = field(default_factory=list)
    aliases: list[tuple[Node, str, str]] = field(default_factory=list)

    @property
    def is_total(self) -> bool:
        """Whether it is a SELECT of one row, because all that it shows is computed over all."""
        shows_rows = self.selects_all or bool(self.projected) or self.grouped is not None
        return bool(self.defined) and not shows_rows

    @property
    def asks_for_kinds(self) -> bool:
        """Whether it only asks if something is of several kinds, to which "no" is an answer."""
        edges = [edge for group in self.body.walk() for edge in group.edges]
        return (
            self.form == "ASK"
            and len({edge.subject.value for edge in edges}) == 1
            and all([it.node.value for it in edge.steps] == [RDF_TYPE.value] for edge in edges)
        )

    def mentions_of(self, variable: str) -> list[Node]:
        """Return every mention of a variable at the end of a pattern."""
        return [
            end
            for group in self.body.walk()
            for edge in group.edges
            for end in edge.ends
            if end.kind == "variable" and end.value == variable
        ]
