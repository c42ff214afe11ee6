"""Seeded sound queries in many forms of SPARQL, made of the statements of a graph or of its schema.

Those made of statements walk from a statement to others of what it mentions. Those of the schema
walk from a property to others whose domain or range its ends may be in, whether or not the graph
has any such statement: that a graph has no data is no fault of a query. Variables are called in the
ways that people do, by letters, classes, properties, or the words of robotics laboratories.
"""

from __future__ import annotations

import random
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from pyoxigraph import Literal, NamedNode, Quad

import ontology
from rtask.asking.check.syntax.writing import written
from rtask.asking.check.types import family
from rtask.asking.check.vocabulary import Property, Vocabulary, local
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import RDF_TYPE, Term, prologue
from tests.rtask.asking.walks import statements

__all__ = ["of_schema", "of_statements"]

_LETTERS = {"letters": "abcdefghijklm", "last letters": "xyzuvwpqrstno"}
_STYLES = (*_LETTERS, "classes", "short", "properties", "synonyms", "heads", "snake")
_SYNONYMS = {
    "Robot": "bot platform machine arm agent robot",
    "Object": "obj thing item target workpiece product body",
    "Grasp": "grip grasp g pick hold",
    "Attempt": "trial attempt execution run",
    "Outcome": "result res outcome",
    "Place": "location loc area place",
    "Pose": "pose position tf transform",
    "Task": "job task goal action",
    "Sensor": "device sensor cam",
    "Observation": "obs look detection measurement",
    "Agent": "agent who user operator",
    "Graph": "g graph source dataset",
    "Activity": "activity act write event",
}
_OF_LITERALS = {
    "number": "value v amount number val x",
    "text": "text s str label v",
    "dateTime": "t ts stamp when moment time",
    "boolean": "flag ok yes is",
}


@dataclass(eq=False)
class _Node:
    """A thing or literal that patterns mention.

    Attributes
    ----------
    kinds
        Classes that it is of, the most specific first; empty for a literal.
    family
        Of the datatype of a literal.
    term
        That stands there in the graph, if it has one.
    via
        Property that leads to it.
    """

    kinds: list[str] = field(default_factory=list)
    family: str = ""
    term: Term | None = None
    via: str = ""
    bits: int | None = None


@dataclass(eq=False)
class _Fact:
    about: _Node
    iri: str
    value: _Node

    def mentions(self, node: _Node) -> bool:
        return self.about is node or self.value is node

    @property
    def ends(self) -> tuple[_Node, _Node]:
        return self.about, self.value


def of_statements(
    kb: KnowledgeBase, vocabulary: Vocabulary, count: int, seed: int
) -> Iterator[str]:
    """Yield queries whose patterns have a match in the graph."""
    about: dict[Term, list[Quad]] = defaultdict(list)
    by_property: dict[str, list[Quad]] = defaultdict(list)
    for quad in statements(kb, vocabulary):
        by_property[quad.predicate.value].append(quad)
        about[quad.subject].append(quad)
        if isinstance(quad.object, NamedNode):
            about[quad.object].append(quad)
    properties = sorted(by_property)
    for at in range(count):
        draw = random.Random(f"statements {seed} {at}")
        walk = [draw.choice(by_property[draw.choice(properties)])]
        for _ in range(draw.randrange(4)):
            ends = {t for q in walk for t in (q.subject, q.object) if isinstance(t, NamedNode)}
            walk.append(draw.choice(about[draw.choice(sorted(ends, key=str))]))
        yield _Writer(vocabulary, draw).query(_facts(kb, vocabulary, walk))


def _facts(kb: KnowledgeBase, vocabulary: Vocabulary, walk: list[Quad]) -> list[_Fact]:
    nodes: dict[object, _Node] = {}

    def node(term: Term, via: str) -> _Node:
        key = term if isinstance(term, NamedNode) else (str(term), via)
        if key not in nodes:
            kinds: list[str] = []
            if isinstance(term, NamedNode):
                found = {
                    q.object.value for q in kb.match(term, RDF_TYPE)
                    if isinstance(q.object, NamedNode) and q.object.value in vocabulary.bit
                }  # fmt: skip
                first = vocabulary.most_specific(found)
                kinds = [*first, *sorted(found - set(first))]
            kind = family(term.datatype.value) if isinstance(term, Literal) else ""
            nodes[key] = _Node(kinds, kind.replace("Stamp", ""), term, via)
        return nodes[key]

    unique = {(str(q.subject), q.predicate.value, str(q.object)): q for q in walk}
    return [
        _Fact(node(q.subject, ""), q.predicate.value, node(q.object, q.predicate.value))
        for q in unique.values()
    ]


def of_schema(kb: KnowledgeBase, vocabulary: Vocabulary, count: int, seed: int) -> Iterator[str]:
    """Yield queries that the domains and ranges of properties allow, whatever the graph holds."""
    usable = {
        iri: made
        for iri, made in sorted(vocabulary.properties.items())
        if iri.startswith(ontology.NS) and made.domain is not None
        if (made.range is not None if made.relates_things else made.datatypes)
    }
    for at in range(count):
        draw = random.Random(f"schema {seed} {at}")
        walk = _SchemaWalk(vocabulary, usable, draw)
        for _ in range(draw.randrange(4)):
            walk.extend()
        yield _Writer(vocabulary, draw).query(walk.facts)


class _SchemaWalk:
    """Facts that the axioms of properties allow together."""

    def __init__(
        self, vocabulary: Vocabulary, usable: dict[str, Property], draw: random.Random
    ) -> None:
        self._vocabulary, self._usable, self._draw = vocabulary, usable, draw
        iri = draw.choice(sorted(usable))
        self.facts = [_Fact(self._node(usable[iri].domain), iri, self._value(iri))]

    def extend(self) -> None:
        """Add a property that one of the things so far may have, or be the value of."""
        nodes = [node for fact in self.facts for node in fact.ends if node.bits is not None]
        node = self._draw.choice(nodes)
        forward = [iri for iri, p in self._usable.items() if (p.domain or 0) & (node.bits or 0)]
        backward = [iri for iri, p in self._usable.items() if (p.range or 0) & (node.bits or 0)]
        if forward and (not backward or self._draw.random() < 0.75):
            iri = self._draw.choice(forward)
            self._narrow(node, self._usable[iri].domain)
            self._add(_Fact(node, iri, self._value(iri)))
        elif backward:
            iri = self._draw.choice(backward)
            self._narrow(node, self._usable[iri].range)
            self._add(_Fact(self._node(self._usable[iri].domain), iri, node))

    def _add(self, fact: _Fact) -> None:
        if all((fact.iri, fact.about) != (had.iri, had.about) for had in self.facts):
            self.facts.append(fact)

    def _value(self, iri: str) -> _Node:
        made = self._usable[iri]
        if made.relates_things:
            node = self._node(made.range)
            node.via = iri
            return node
        return _Node(family=family(min(made.datatypes)).replace("Stamp", ""), via=iri)

    def _node(self, bits: int | None) -> _Node:
        node = _Node(bits=bits)
        self._narrow(node, bits)
        return node

    def _narrow(self, node: _Node, bits: int | None) -> None:
        node.bits = (node.bits or 0) & (bits or 0)
        kinds = self._vocabulary.most_general(node.bits)
        node.kinds = [iri for iri in kinds if iri.startswith(ontology.NS)] or kinds


class _Writer:
    """Writes one query."""

    def __init__(self, vocabulary: Vocabulary, draw: random.Random) -> None:
        self._vocabulary, self._draw = vocabulary, draw
        self._style = draw.choice(_STYLES)
        self._names: dict[_Node, str] = {}
        self._shown: list[str] = []

    def query(self, facts: list[_Fact]) -> str:
        """Return the text for some facts that hang together, in a form that suits them."""
        for fact in facts:
            for node in fact.ends:
                self._name(node)
        forms: list[Callable[[list[_Fact]], str | None]] = [
            self._plain, self._apart, self._union, self._values, self._constant, self._expression,
            self._aggregate, self._sub_select, self._path, self._graph, self._predicate, self._type,
        ]  # fmt: skip
        self._draw.shuffle(forms)
        text = next(text for text in (form(facts) for form in forms) if text)
        return prologue(ontology.PREFIXES) + text

    # Parts of a query.

    def _pattern(self, fact: _Fact) -> str:
        subject, value = self._term(fact.about), self._term(fact.value)
        if self._draw.random() < 0.08 and value.startswith("?"):
            return f"{value} ^{_short(fact.iri)} {subject} ."
        return f"{subject} {_short(fact.iri)} {value} ."

    def _patterns(self, facts: list[_Fact]) -> str:
        lines = [self._pattern(fact) for fact in facts]
        for node in dict.fromkeys(node for fact in facts for node in fact.ends):
            if node.kinds and self._draw.random() < 0.3:
                lines.append(f"{self._term(node)} a {_short(self._kind(node))} .")
        self._draw.shuffle(lines)
        return " ".join(lines)

    def _kind(self, node: _Node) -> str:
        ours = [iri for iri in node.kinds if iri.startswith(ontology.NS)]
        return self._draw.choice(ours or node.kinds)

    def _term(self, node: _Node) -> str:
        return f"?{self._names[node]}"

    def _head(self, facts: list[_Fact], *more: str) -> str:
        names = sorted({self._term(node) for fact in facts for node in fact.ends})
        some = self._draw.sample(names, self._draw.randrange(1, len(names) + 1))
        shown = self._draw.choice(("*", " ".join([*some, *more])))
        return f"SELECT {self._draw.choice(('', 'DISTINCT '))}{shown}"

    # Forms; None where the facts do not suit one.

    def _plain(self, facts: list[_Fact]) -> str:
        body = self._patterns(facts)
        head = self._draw.choice((self._head(facts), "ASK", f"CONSTRUCT {{ {body} }}"))
        if "^" in head:  # a template has no paths
            head = "SELECT *"
        return f"{head} WHERE {{ {body} }}"

    def _apart(self, facts: list[_Fact]) -> str | None:
        if len(facts) < 2:
            return None
        cut = self._draw.randrange(1, len(facts))
        kept, apart = facts[:cut], self._patterns(facts[cut:])
        word = self._draw.choice(
            ("OPTIONAL", "OPTIONAL", "MINUS", "FILTER NOT EXISTS", "FILTER EXISTS")
        )
        shown = facts if word == "OPTIONAL" else kept
        return f"{self._head(shown)} WHERE {{ {self._patterns(kept)} {word} {{ {apart} }} }}"

    def _union(self, facts: list[_Fact]) -> str | None:
        if len(facts) < 3:
            return None
        first, *others = facts
        branches = [fact for fact in others if any(first.mentions(end) for end in fact.ends)]
        if len(branches) < 2:
            return None
        text = " UNION ".join(f"{{ {self._patterns([fact])} }}" for fact in branches)
        return f"{self._head([first, *branches])} WHERE {{ {self._patterns([first])} {text} }}"

    def _values(self, facts: list[_Fact]) -> str | None:
        nodes = [node for fact in facts for node in fact.ends if node.term is not None]
        if not nodes:
            return None
        node = self._draw.choice(nodes)
        block = f"VALUES {self._term(node)} {{ {_constant(node)} }}"
        return f"{self._head(facts)} WHERE {{ {block} {self._patterns(facts)} }}"

    def _constant(self, facts: list[_Fact]) -> str | None:
        nodes = [node for fact in facts for node in fact.ends if node.term is not None]
        if not nodes or len({node for fact in facts for node in fact.ends}) < 3:
            return None
        node = self._draw.choice(nodes)
        mark = f"{self._term(node)} "
        body = f"{self._patterns(list(facts))} "
        head = self._head([f for f in facts if not f.mentions(node)] or facts)
        if mark.strip() in head.split():
            head = "SELECT *"
        lines = body.replace(mark, f"{_constant(node)} ")
        if (node.family and lines.startswith(_constant(node))) or f". {_constant(node)} ^" in lines:
            return None
        return f"{head} WHERE {{ {lines}}}"

    def _expression(self, facts: list[_Fact]) -> str | None:
        values = [fact.value for fact in facts if fact.value.family in _FILTERS]
        if not values:
            return None
        node = self._draw.choice(values)
        name, body = self._term(node), self._patterns(facts)
        if self._draw.random() < 0.4:
            bind = self._draw.choice(_BINDS[node.family]).replace("?x", name)
            return f"{self._head(facts, '?made')} WHERE {{ {body} BIND({bind} AS ?made) }}"
        test = self._draw.choice(_FILTERS[node.family]).replace("?x", name)
        order = self._draw.choice(("", f" ORDER BY DESC({name}) LIMIT 5"))
        return f"{self._head(facts)} WHERE {{ {body} FILTER({test}) }}{order}"

    def _aggregate(self, facts: list[_Fact]) -> str:
        key = self._draw.choice(facts).about
        counted = self._draw.choice([fact.value for fact in facts])
        call = self._draw.choice(_AGGREGATES["number" if counted.family == "number" else "any"])
        call = call.replace("?x", self._term(counted))
        after = self._draw.choice(("", " HAVING (COUNT(*) > 1)", " ORDER BY DESC(?total)"))
        return (
            f"SELECT {self._term(key)} ({call} AS ?total) WHERE {{ {self._patterns(facts)} }} "
            f"GROUP BY {self._term(key)}{after}"
        )

    def _sub_select(self, facts: list[_Fact]) -> str | None:
        if len(facts) < 2:
            return None
        cut = self._draw.randrange(1, len(facts))
        inside, outside = facts[:cut], facts[cut:]
        ends = [node for fact in inside for node in fact.ends]
        keys = [node for node in ends if any(fact.mentions(node) for fact in outside)]
        counted = next((self._term(node) for node in ends if node not in keys), "*")
        if not keys or any(
            fact.mentions(node) for node in set(ends) - {keys[0]} for fact in outside
        ):
            return None
        key = self._term(keys[0])
        inner = (
            f"SELECT {key} (COUNT({counted}) AS ?n0) WHERE {{ {self._patterns(inside)} }} "
            f"GROUP BY {key}"
        )
        return f"SELECT {key} ?n0 WHERE {{ {{ {inner} }} {self._patterns(outside)} }}"

    def _path(self, facts: list[_Fact]) -> str | None:
        for first in facts:
            for other in facts:
                middle = first.value
                lone = sum(fact.mentions(middle) for fact in facts) == 2
                if other is first or other.about is not middle or not lone:
                    continue
                rest = [fact for fact in facts if fact not in (first, other)]
                path = f"{_short(first.iri)}/{_short(other.iri)}"
                line = f"{self._term(first.about)} {path} {self._term(other.value)} ."
                if self._draw.random() < 0.3:
                    path = f"^{_short(other.iri)}/^{_short(first.iri)}"
                    line = f"{self._term(other.value)} {path} {self._term(first.about)} ."
                ends = _Fact(first.about, "", other.value)
                return (
                    f"{self._head([*rest, ends])} WHERE {{ {line} "
                    f"{self._patterns(rest) if rest else ''} }}"
                )
        return None

    def _graph(self, facts: list[_Fact]) -> str:
        name = self._draw.choice(("g0", "graph", "src", "source", "where0"))
        if name in self._names.values():
            name = "g00"
        rest = f" {self._patterns(facts[1:])}" if len(facts) > 1 else ""
        inside = self._pattern(facts[0])
        return f"{self._head(facts, f'?{name}')} WHERE {{ GRAPH ?{name} {{ {inside} }}{rest} }}"

    def _predicate(self, facts: list[_Fact]) -> str:
        fact, *rest = facts
        iri = _short(fact.iri)
        limit = self._draw.choice((f"VALUES ?p0 {{ {iri} }}", f"FILTER(?p0 = {iri})"))
        line = f"{self._term(fact.about)} ?p0 {self._term(fact.value)} . {limit}"
        body = f"{line} {self._patterns(rest) if rest else ''}"
        return f"{self._head(facts, '?p0')} WHERE {{ {body} }}"

    def _type(self, facts: list[_Fact]) -> str | None:
        nodes = [node for fact in facts for node in fact.ends if node.kinds]
        if not nodes:
            return None
        node = self._draw.choice(nodes)
        kind, name = _short(self._kind(node)), self._term(node)
        line = self._draw.choice((
            f"{name} a/rdfs:subClassOf* {kind} .",
            f"{name} a ?kind0 . ?kind0 rdfs:subClassOf* {kind} .",
            f"{name} a ?kind0 . ?kind0 rdfs:label ?label0 . FILTER(LANG(?label0) = 'en')",
            f"{name} a ?type0 . FILTER(?type0 != {kind})",
        ))  # fmt: skip
        return f"{self._head(facts)} WHERE {{ {line} {self._patterns(facts)} }}"

    # Names.

    def _name(self, node: _Node) -> None:
        if node in self._names:
            return
        word = self._word(node)
        taken = set(self._names.values())
        number = next(at for at in range(1, 99) if (f"{word}{at}" if at > 1 else word) not in taken)
        self._names[node] = f"{word}{number}" if number > 1 else word

    def _word(self, node: _Node) -> str:
        style, draw = self._style, self._draw
        if style in _LETTERS:
            return _LETTERS[style][len(self._names)]
        by_property = local(node.via).removeprefix("has") or "value"
        if style == "synonyms":
            word = self._synonym(node) or by_property
            word = local(node.kinds[0]) if node.kinds and word == "value" else word
        elif node.kinds and not (style == "properties" and node.via):
            word = local(draw.choice(node.kinds))
        else:
            word = by_property
        word = word[0].lower() + word[1:]
        parts = "".join(f" {c.lower()}" if c.isupper() else c for c in word).split()
        if style == "heads":
            word = parts[-1]
        elif style == "snake":
            word = "_".join(parts)
        short = "".join(part[0] for part in parts) if len(parts) > 1 else word[:3]
        return short if style == "short" else word

    def _synonym(self, node: _Node) -> str:
        if node.family:
            return self._draw.choice(_OF_LITERALS.get(node.family, "value").split())
        kinds = self._vocabulary.above[node.kinds[0]] if node.kinds else ()
        words = [
            word for name, text in _SYNONYMS.items() for word in text.split()
            if any(local(kind) in (name, f"Manipulable{name}", f"Grasp{name}") for kind in kinds)
        ]  # fmt: skip
        return self._draw.choice(words) if words else ""


_FILTERS = {
    "number": ("?x > 0", "?x <= 10.5", "?x >= 0 && ?x < 100", "ABS(?x) > 0.5", "?x + 1 > 0"),
    "text": ("CONTAINS(LCASE(?x), 'a')", "REGEX(?x, '^a', 'i')", "STRLEN(?x) > 2", "?x != 'none'"),
    "dateTime": (
        "?x < NOW()", "?x > '2026-01-01T00:00:00Z'^^xsd:dateTime", "YEAR(?x) = 2026",
    ),
    "boolean": ("?x", "!?x", "?x = true"),
}  # fmt: skip
_BINDS = {
    "number": ("ROUND(?x * 100) / 100", "?x * 1000", "IF(?x > 0, 'yes', 'no')", "STR(?x)"),
    "text": ("UCASE(?x)", "STRLEN(?x)", "CONCAT('the ', ?x)", "STRBEFORE(?x, '-')"),
    "dateTime": ("HOURS(?x)", "xsd:date(?x)", "STR(?x)"),
    "boolean": ("IF(?x, 1, 0)", "xsd:integer(?x)"),
}
_AGGREGATES = {
    "number": ("AVG(?x)", "SUM(?x)", "MAX(?x)", "COUNT(?x)"),
    "any": ("COUNT(?x)", "COUNT(DISTINCT ?x)", "SAMPLE(?x)", "MIN(?x)",
            "GROUP_CONCAT(DISTINCT STR(?x); SEPARATOR=', ')"),
}  # fmt: skip


def _short(iri: str) -> str:
    return written(iri, ontology.PREFIXES)


def _constant(node: _Node) -> str:
    return str(node.term)
