"""Terms that neither the ontology nor the graph knows, or that stand where another kind does."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import ontology
from rtask.asking.check.findings import Edit, Finding, Repair, Severity
from rtask.asking.check.fitting import Fitting
from rtask.asking.check.metamodel import (
    is_reserved,
    is_shacl,
    reserved_terms,
    shacl_terms,
)
from rtask.asking.check.naming.names import likeness, may_be_like
from rtask.asking.check.syntax.outline import Edge, Node, Outline
from rtask.asking.check.syntax.writing import written
from rtask.asking.check.types import TYPE
from rtask.asking.check.vocabulary import local
from rtask.asking.questions.words import split_name
from rtask.rdf.terms import NamedNode
from rtask.sparql.place_service import PLACE_SERVICE

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore

__all__ = ["Unknown"]

_OFFERED = 3
_MIN_LIKENESS, _NEAR = 0.55, 0.68
_MAX_NAMES = 5_000
_SUB_CLASS = (ontology.PREFIXES["rdfs"] + "subClassOf", ontology.PREFIXES["owl"] + "disjointWith")
_OF_SERVICE = {
    ontology.NS + name for name in ("matches", "score", "text", "lang", "limit", "subjects")
}
_AUXILIARIES = re.compile(r"^(?:has|is|was|get)(?=[A-Z])")
# These are open: applications use terms of them that no loaded ontology repeats.
_OPEN = tuple(ontology.PREFIXES[name] for name in ("sh", "unit"))


_DECLARED = re.compile(r"^rt:([\w-]+) a ", re.M)


@lru_cache(maxsize=1)
def shipped_terms() -> Mapping[str, str]:
    """Return the terms of the ontology that comes with this version, each with its module.

    A graph that was made by an earlier version, and not upgraded, does not know all of them.
    """
    return MappingProxyType(
        {
            ontology.NS + name: file.stem
            for file in ontology.modules()
            for name in _DECLARED.findall(file.read_text("utf-8"))
        }
    )


class Unknown:
    """Looks for unknown terms in one query."""

    def __init__(self, kb: GraphCore, fitting: Fitting, outline: Outline) -> None:
        self._kb = kb
        self._vocabulary = fitting.vocabulary
        self._evidence = fitting.evidence
        self._outline = outline
        self._fitting = fitting

    def findings(self) -> Iterator[Finding]:
        """Yield the unknown and misplaced terms of a query."""
        seen: set[int] = set()
        for group in self._outline.body.walk():
            if group.role == "service":
                seen.update(node.start for edge in group.edges for node in _iris(edge))
                continue
            for edge in group.edges:
                yield from self._of_edge(edge)
                seen.update(node.start for node in _iris(edge))
            for _, terms in group.values:
                yield from self._mentions(terms)
            if group.graph is not None and group.graph.kind == "iri":
                yield from self._mention(group.graph)
                yield from self._no_graph(group.graph)
        yield from self._mentions(node for node in self._outline.iris if node.start not in seen)

    def _no_graph(self, node: Node) -> Iterator[Finding]:
        """Yield a class or property that stands for a graph: patterns there match nothing.

        Of other things it is not certain: a graph may be described before anything is in it.
        """
        if node.value not in self._vocabulary.bit and node.value not in self._vocabulary.properties:
            return
        graph = NamedNode(node.value)
        if next(iter(self._kb.store.quads_for_pattern(None, None, None, graph)), None) is None:
            words = f"{self._short(node)} is a class or property and no graph: nothing is in it"
            yield Finding("no-graph", "certain", node.start, node.end, words)

    def _of_edge(self, edge: Edge) -> Iterator[Finding]:
        for step in edge.steps:
            yield from self._predicate(step.node, edge)
        types = any(step.node.value == TYPE for step in edge.steps)
        for at, node in enumerate(edge.ends):
            if node.kind == "iri":
                yield from self._class(node, edge) if types and at == 1 else self._mention(node)

    def _predicate(self, node: Node, edge: Edge) -> Iterator[Finding]:
        iri = node.value
        if iri in _OF_SERVICE and not self._evidence.matches(edge):
            words = f"{local(iri)} is answered inside SERVICE <urn:rtask:text> {{ }} only"
            yield Finding("needs-service", "certain", node.start, node.end, words)
            return
        if iri.startswith(ontology.FUNCTIONS):
            words = f"{local(iri)} is answered inside SERVICE <{PLACE_SERVICE}> {{ }} only"
            yield Finding("needs-service", "certain", node.start, node.end, words)
            return
        if iri == TYPE or iri in self._vocabulary.properties:
            return
        if is_reserved(iri) is False:
            yield from self._misspelt(node, edge)
            return
        if iri.startswith(_OPEN) or is_reserved(iri):
            yield from self._near_open(node, edge)
            return
        if iri in self._vocabulary.bit:
            words = f"{self._short(node)} is a class, not a property"
            candidates = self._near(node, self._vocabulary.properties)
            yield self._finding("class-as-property", node, words, candidates, edge)
        elif not self._evidence.is_used(iri):
            candidates = self._near(node, self._vocabulary.properties)
            severity = self._severity(iri, candidates)
            if severity:
                words = f"there is no property {self._short(node)}"
                yield self._finding("unknown-term", node, words, candidates, edge, severity)

    def _class(self, node: Node, edge: Edge) -> Iterator[Finding]:
        iri = node.value
        if is_reserved(iri) is False:
            yield from self._misspelt(node, edge)
            return
        if iri in self._vocabulary.bit or iri.startswith(_OPEN) or is_reserved(iri):
            yield from self._near_open(node, edge)
            return
        if iri in self._vocabulary.properties:
            words = f"{self._short(node)} is a property, not a class"
            candidates = self._near(node, self._vocabulary.bit)
            yield self._finding("property-as-class", node, words, candidates, edge)
        elif not self._evidence.is_used(iri):
            candidates = self._near(node, self._vocabulary.bit)
            severity = self._severity(iri, candidates)
            if severity:
                words = f"there is no class {self._short(node)}"
                yield self._finding("unknown-term", node, words, candidates, edge, severity)

    def _mentions(self, nodes: Iterable[Node]) -> Iterator[Finding]:
        for node in nodes:
            if node.kind == "iri":
                yield from self._mention(node)

    def _mention(self, node: Node) -> Iterator[Finding]:
        """Yield a fault of an IRI that may be of any kind."""
        iri, vocabulary = node.value, self._vocabulary
        if iri in self._outline.prefixes.values():
            return  # STRSTARTS(STR(?term), STR(rt:)) asks for what is in it
        if is_reserved(iri) is False:
            yield from self._misspelt(node, None)
            return
        if iri in vocabulary.bit or iri in vocabulary.properties or iri.startswith(_OPEN):
            return
        is_own = not self._kb.plain and iri.startswith(self._kb.base)
        if not (is_own or iri.startswith(ontology.NS)) or self._evidence.is_used(iri):
            return
        if is_own:
            words = f"nothing in the graph is called {self._short(node)}"
            yield self._finding("unknown-thing", node, words, self._things(node), None)
        else:
            near = self._near(node, (*vocabulary.bit, *vocabulary.properties))
            words = f"there is no term {self._short(node)}"
            yield self._finding("unknown-term", node, words, near, None)

    def _near_open(self, node: Node, edge: Edge) -> Iterator[Finding]:
        """Yield a term of SHACL that its recommendation does not have, but one spelt much like it.

        The vocabulary is open to extensions, so that what is like none of its terms is no fault.
        """
        if is_shacl(node.value) is not False or self._evidence.is_used(node.value):
            return
        name = local(node.value).lower()
        near = max(shacl_terms(), key=lambda iri: likeness(name, local(iri).lower()))
        if likeness(name, local(near).lower()) >= _NEAR:
            words = f"there is no term {self._short(node)}"
            yield self._finding("unknown-term", node, words, [near], edge, "likely")

    def _misspelt(self, node: Node, edge: Edge | None) -> Iterator[Finding]:
        """Yield the fault of a term that a closed vocabulary does not have."""
        if self._evidence.is_used(node.value):
            return
        name = local(node.value).lower()
        rated = sorted(
            (-likeness(name, local(iri).lower()), iri) for iri in reserved_terms(node.value)
        )
        near = [iri for rating, iri in rated if -rating >= _MIN_LIKENESS]
        words = f"there is no term {self._short(node)}"
        yield self._finding("unknown-term", node, words, near, edge, "certain")

    def _severity(self, iri: str, candidates: list[str]) -> Severity | None:
        """Return how sure it is that an unknown term is a fault; None for not at all."""
        if iri.startswith(ontology.NS) or (not self._kb.plain and iri.startswith(self._kb.base)):
            return "certain"
        if candidates and local(iri) == local(candidates[0]) and _is_of_site(iri, candidates[0]):
            return "likely"  # http for https, or "/" for "#": the namespace is the slip
        namespace = iri[: len(iri) - len(local(iri))]
        in_known = namespace in self._vocabulary.namespaces
        is_near = bool(candidates) and likeness(local(iri), local(candidates[0])) >= _NEAR
        return "likely" if in_known and is_near else None

    def _near(self, node: Node, known: Iterable[str]) -> list[str]:
        """Return the known terms with names like that of an unknown one, the nearest first."""
        name = local(node.value).lower()
        namespace = node.value[: len(node.value) - len(local(node.value))]
        rated = []
        longest = max(4, len(name) // 2)
        lowered = self._vocabulary.lowered
        for iri in known:
            other = lowered[iri]
            if not -longest <= len(other) - len(name) <= longest:
                continue
            if not may_be_like(name, other, _MIN_LIKENESS - 0.1):
                continue
            rating = likeness(name, other) + (0.1 if iri.startswith(namespace) else 0.0)
            if rating >= _MIN_LIKENESS:
                rated.append((-rating, iri))
        near = [iri for _, iri in sorted(rated)[:12]]
        names = _names(node)
        called = [iri for iri in known if iri not in near and self._is_called(iri, names)]
        return sorted(called)[:_OFFERED] + near

    def _is_called(self, iri: str, names: tuple[str, str]) -> bool:
        """Return whether a term has the words of an unknown one as its label, or for its name.

        A carton is a box by its label, and a name with "has" before it says no more than without.
        """
        bare, spoken = names
        return self._vocabulary.lowered[iri] == bare or spoken in self._vocabulary.labels.get(
            iri, ()
        )

    def _things(self, node: Node) -> list[str]:
        """Return the things of the graph whose IRIs or names are near an unknown one."""
        from rtask.rdf.terms import Literal, NamedNode

        base = self._kb.base
        asked = node.value[len(base) :].lower()
        rated: dict[str, float] = {}
        rows = self._kb.store.quads_for_pattern(None, NamedNode(ontology.NS + "name"), None, None)
        for count, quad in enumerate(rows):
            if count >= _MAX_NAMES:
                break
            if isinstance(quad.subject, NamedNode) and quad.subject.value.startswith(base):
                path = quad.subject.value[len(base) :].lower()
                name = quad.object.value.lower() if isinstance(quad.object, Literal) else ""
                rating = max(likeness(asked, path), likeness(asked.rpartition("/")[2], name) - 0.05)
                rated[quad.subject.value] = max(rating, rated.get(quad.subject.value, 0.0))
        best = sorted(rated, key=lambda iri: (-rated[iri], iri))
        return [iri for iri in best if rated[iri] >= _MIN_LIKENESS][:_OFFERED]

    def _finding(
        self,
        rule: str,
        node: Node,
        words: str,
        candidates: list[str],
        edge: Edge | None,
        severity: Severity = "certain",
    ) -> Finding:
        module = shipped_terms().get(node.value) if rule == "unknown-term" else None
        if module is not None:
            words = (
                f"{self._short(node)} is in the ontology of this version of RTASK "
                f"(module {module}), but not in that of the graph, which is upgraded when it is "
                "opened for writing"
            )
            return Finding(rule, severity, node.start, node.end, words)
        if edge is not None:
            candidates = self._fitting.ranked(candidates, node, edge)
        names = _names(node)
        known = self._vocabulary.lowered
        candidates.sort(key=lambda iri: not (iri in known and self._is_called(iri, names)))
        repairs = []
        for iri in candidates[:_OFFERED]:
            text = written(iri, self._outline.prefixes, self._kb.base)
            repairs.append(Repair(f"write {text}", (Edit(node.start, node.end, text),)))
        hint = f"; did you mean {repairs[0].edits[0].text}?" if repairs else ""
        return Finding(
            rule,
            severity,
            node.start,
            node.end,
            words + hint,
            tuple(repairs),
        )

    def _short(self, node: Node) -> str:
        return written(node.value, self._outline.prefixes, self._kb.base)


def _is_of_site(iri: str, other: str) -> bool:
    """Return whether two IRIs begin with the same host and the same first part of the path."""
    sites = [(parts.netloc, parts.path.split("/")[1:2]) for parts in map(urlsplit, (iri, other))]
    return bool(sites[0][0]) and sites[0] == sites[1]


def _names(node: Node) -> tuple[str, str]:
    """Return the name of an unknown term without "has" or "is", and its words as a label."""
    name = local(node.value)
    return _AUXILIARIES.sub("", name).lower(), " ".join(split_name(name)).lower()


def _iris(edge: Edge) -> list[Node]:
    return [*(step.node for step in edge.steps), *(end for end in edge.ends if end.kind == "iri")]
