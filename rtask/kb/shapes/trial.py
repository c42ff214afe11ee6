"""Trial of shapes on nodes made for it, so that one that cannot be applied stops no other."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache
from itertools import pairwise
from typing import Any

from rtask.errors import QuerySyntaxError
from rtask.rdf.terms import RDF_TYPE, Literal, NamedNode, Term, TripleKey, literal
from rtask.sparql.lexer import tokenise

__all__ = ["Components", "components_of", "faults_of"]

Lines = tuple[TripleKey, ...]

_SH = "http://www.w3.org/ns/shacl#"
_TEXTS = frozenset(_SH + name for name in ("select", "ask", "construct"))
_PATH, _TARGET_NODE = NamedNode(_SH + "path"), NamedNode(_SH + "targetNode")
_COMPONENT = NamedNode(_SH + "ConstraintComponent")
_NODES = tuple(NamedNode(f"urn:rtask:shape-trial:{k}") for k in range(3))


class Components:
    """Custom constraint components (SHACL 2017, 6).

    Attributes
    ----------
    lines
        Statements of those that can be applied, and whatever else belongs to no shape.
    left_out
        Why each other one cannot.
    """

    def __init__(self, lines: Lines, left_out: Mapping[Term, str], parameters: Mapping[Term, Term]):
        self.lines = lines
        self.left_out = left_out
        self._parameters = parameters

    def fault_of(self, definition: Iterable[TripleKey]) -> str:
        """Return why a shape cannot use its components, or an empty text."""
        for _, predicate, _ in definition:
            component = self._parameters.get(predicate)
            if component is not None and component in self.left_out:
                return f"it uses {component}, which is not applied: {self.left_out[component]}"
        return ""


def components_of(lines: Iterable[TripleKey]) -> Components:
    """Try the custom constraint components among statements, each by itself."""
    rest = tuple(lines)
    about: dict[Term, list[TripleKey]] = {}
    for line in rest:
        about.setdefault(line[0], []).append(line)
    left_out: dict[Term, str] = {}
    parameters: dict[Term, Term] = {}
    dropped: set[TripleKey] = set()
    for node in sorted((s for s, p, o in rest if p == RDF_TYPE and o == _COMPONENT), key=str):
        own = _reachable(node, about)
        parameters |= {value: node for _, predicate, value in own if predicate == _PATH}
        fault = _calls_out(own) or _tried((), own)
        if fault:
            left_out[node] = fault
            dropped.update(own)
    return Components(tuple(line for line in rest if line not in dropped), left_out, parameters)


def faults_of(shapes: Mapping[Term, Lines], components: Components) -> dict[Term, str]:
    """Return why shapes cannot be applied, for those for which that is so.

    The validator looks at a constraint only when it meets a node, so that a broken shape would pass
    as long as nothing is of its kind, and then refuse whatever is. So each is tried on the first of
    three nodes, each of which has a text and the next node as values of each property that the
    shape names; a ring would have shapes that refer to themselves go round.

    Parameters
    ----------
    shapes
        Definition of each shape with those that it uses, by its node.
    """
    faults = {}
    for node, definition in shapes.items():
        fault = _calls_out(definition) or components.fault_of(definition)
        if fault:
            faults[node] = fault
    sound = {node: lines for node, lines in shapes.items() if node not in faults}
    whole = tuple(dict.fromkeys(line for lines in sound.values() for line in lines))
    if sound and _tried(tuple(sound), (*whole, *components.lines)):  # one of them, at least
        for node, definition in sound.items():
            fault = _tried((node,), (*definition, *components.lines))
            if fault:
                faults[node] = fault
    return faults


@lru_cache(maxsize=1024)
def _tried(shapes: tuple[Term, ...], definitions: Lines) -> str:
    """Return what the validator refuses in definitions, or an empty text."""
    from reasoner.shacl import ShapesError, validate

    properties = {
        value for _, predicate, value in definitions
        if predicate == _PATH and isinstance(value, NamedNode)
    }  # fmt: skip
    data: Any = [(node, path, literal("a text")) for path in properties for node in _NODES]
    data += [(node, path, after) for path in properties for node, after in pairwise(_NODES)]
    aimed: Any = [*definitions, *((shape, _TARGET_NODE, _NODES[0]) for shape in shapes)]
    try:
        validate(data, aimed, _NODES[:1])
    except ShapesError as error:
        return str(error)
    return ""


def _reachable(start: Term, about: Mapping[Term, Iterable[TripleKey]]) -> Lines:
    """Return the statements about a node and about what it leads to."""
    lines: list[TripleKey] = []
    waiting, seen = [start], {start}
    while waiting:
        for line in about.get(waiting.pop(), ()):
            lines.append(line)
            if line[1] != RDF_TYPE and line[2] not in seen:
                seen.add(line[2])
                waiting.append(line[2])
    return tuple(lines)


def _calls_out(definition: Iterable[TripleKey]) -> str:
    """Return that a shape's SPARQL would read from elsewhere, or an empty text."""
    for _, predicate, value in definition:
        if predicate.value in _TEXTS and isinstance(value, Literal):
            try:
                tokens = tokenise(value.value)
            except QuerySyntaxError:
                continue  # the validator says what is wrong
            for word in ("SERVICE", "FROM"):
                if any(token.is_word(word) for token in tokens):
                    return f"its SPARQL uses {word}"
    return ""
