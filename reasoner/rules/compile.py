"""From a closed schema to rules over its instances (OWL 2 Profiles 4.3, tables 4 to 8).

Predicates and classes of an ontology are constants here, so that each compiled rule has a short
body and a known predicate in every atom.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from reasoner.rules.rule import Atom, Clash, Differ, InDatatype, Rule, View
from reasoner.rules.schema import BadListError, SchemaProblem, read_list
from reasoner.terms import vocabulary as v
from reasoner.terms.dictionary import Dictionary, Fact

_X, _Y, _Z = -1, -2, -3
MAX_BODY = 256
"""Atoms in the body of a rule; an axiom that needs more is ignored and reported as a problem."""
_RULE_WORK = 20
"""Candidates that compiling a rule counts as."""
_IN_BODIES = (v.CHAIN, v.INTERSECTION, v.HAS_KEY)
"""Lists that become the body of one rule."""


@dataclass(frozen=True, slots=True)
class Distinct:
    """A list of individuals that are pairwise different (eq-diff2, eq-diff3)."""

    name: str
    items: tuple[Fact, ...]
    """The rdf:first facts of the list, in order."""
    because: tuple[Fact, ...]


@dataclass
class CompiledSchema:
    """Rules of a schema, and the axioms that could not be read."""

    rules: list[Rule] = field(default_factory=list)
    distinct: list[Distinct] = field(default_factory=list)
    problems: list[SchemaProblem] = field(default_factory=list)


def compile_schema(view: View, terms: Dictionary) -> CompiledSchema:
    """Compile the schema facts of a view that is closed under the scm-* rules.

    Parameters
    ----------
    view : View
        Facts on representatives.
    terms : Dictionary

    Returns
    -------
    CompiledSchema
    """
    return _Compiler(view, terms).run()


def compile_lists(view: View, terms: Dictionary) -> list[Rule]:
    """Compile the direct consequences of class lists (scm-int, scm-uni), which close the schema."""
    return [rule for rule in _Compiler(view, terms).lists_of_classes() if not rule.body]


class _Compiler:
    def __init__(self, view: View, terms: Dictionary) -> None:
        self.view = view
        self.terms = terms
        self.out = CompiledSchema()

    def run(self) -> CompiledSchema:
        families: tuple[Callable[[], Iterator[Rule]], ...] = (
            self.hierarchies,
            self.sides,
            self.characteristics,
            self.inverses_and_chains,
            self.lists_of_classes,
            self.restrictions,
            self.keys,
            self.disjoint,
            self.negative_assertions,
        )
        work = self.view.work
        for family in families:
            for rule in family():
                if work is not None:
                    # The order of a body is sought for each of its atoms.
                    effort = _RULE_WORK + len(rule.body) ** 3 // 8 + len(rule.because) // 8
                    work.count(effort, rule)
                self.out.rules.append(rule)
        self.all_different()
        self.out.rules += self.types_as_owl_thing()
        return self.out

    def members(self, axiom: int, p: int) -> Iterator[tuple[tuple[int, ...], tuple[Fact, ...]]]:
        """Yield each readable list of an axiom with the facts that state it."""
        for head in sorted(self.view.objects(p, axiom)):
            try:
                members, facts = read_list(self.view, head)
            except BadListError as error:
                self.out.problems.append(SchemaProblem(axiom, str(error)))
            else:
                if self.view.work is not None:
                    self.view.work.count(len(members))
                if p in _IN_BODIES and len(members) > MAX_BODY:
                    message = f"the list has {len(members)} members, more than {MAX_BODY}"
                    self.out.problems.append(SchemaProblem(axiom, message))
                    continue
                yield members, ((axiom, p, head), *facts)

    def typed(self, kind: int) -> list[int]:
        return sorted(self.view.subjects(v.TYPE, kind))

    def is_data(self, p: int) -> bool:
        return self.view.has(p, v.TYPE, v.DATATYPE_PROPERTY)

    def is_literal_class(self, c: int) -> bool:
        return c in v.LITERAL_CLASSES or (c >= v.RESERVED and self.view.has(c, v.TYPE, v.DATATYPE))

    # Table 9 closed, tables 5 and 7: hierarchies.

    def hierarchies(self) -> Iterator[Rule]:
        for c, d in _reduced(self.view, v.SUB_CLASS):
            if d != v.THING and c != v.NOTHING:
                yield Rule("cax-sco", (_type(c, _X),), _type(d, _X), ((c, v.SUB_CLASS, d),))
        for p, q in _reduced(self.view, v.SUB_PROPERTY):
            if q not in (v.TOP_OBJECT, v.TOP_DATA):
                yield Rule(
                    "prp-spo1", (Atom(_X, p, _Y),), Atom(_X, q, _Y), ((p, v.SUB_PROPERTY, q),)
                )

    def sides(self) -> Iterator[Rule]:
        """Domains and ranges, left out where a broader property or a narrower class says it."""
        for side, name, subject in ((v.DOMAIN, "prp-dom", _X), (v.RANGE, "prp-rng", _Y)):
            for p, c in sorted(self.view.pairs(side)):
                if c in (v.THING, v.RESOURCE) or self._is_implied(side, p, c):
                    continue
                because: tuple[Fact, ...] = ((p, side, c),)
                body = (Atom(_X, p, _Y),)
                if not self.is_literal_class(c):
                    yield Rule(name, body, _type(c, subject), because)
                elif side == v.RANGE and c in v.DATATYPES.values():
                    outside = (InDatatype(_Y, c, inside=False),)
                    yield Rule("dt-not-type", body, None, because, outside)

    def _is_implied(self, side: int, p: int, c: int) -> bool:
        has, work = self.view.has, self.view.work
        if work is not None:
            work.count(1 + len(self.view.objects(side, p)))
        return any(
            b != c and has(b, v.SUB_CLASS, c) and not has(c, v.SUB_CLASS, b)
            for b in self.view.objects(side, p)
        ) or any(
            q != p and has(q, side, c) and not has(q, v.SUB_PROPERTY, p)
            for q in self.view.objects(v.SUB_PROPERTY, p)
        )

    # Table 5: characteristics of properties.

    def characteristics(self) -> Iterator[Rule]:
        for p in self.typed(v.SYMMETRIC):
            yield self._about(v.SYMMETRIC, p, "prp-symp", (Atom(_X, p, _Y),), Atom(_Y, p, _X))
        for p in self.typed(v.TRANSITIVE):
            body = (Atom(_X, p, _Y), Atom(_Y, p, _Z))
            yield self._about(v.TRANSITIVE, p, "prp-trp", body, Atom(_X, p, _Z))
        for p in self.typed(v.FUNCTIONAL):
            body = (Atom(_X, p, _Y), Atom(_X, p, _Z))
            yield from self._equal("prp-fp", body, _Y, _Z, ((p, v.TYPE, v.FUNCTIONAL),))
        for p in self.typed(v.INVERSE_FUNCTIONAL):
            body = (Atom(_Y, p, _X), Atom(_Z, p, _X))
            because = ((p, v.TYPE, v.INVERSE_FUNCTIONAL),)
            yield from self._equal("prp-ifp", body, _Y, _Z, because)
        for p in self.typed(v.IRREFLEXIVE):
            yield self._about(v.IRREFLEXIVE, p, "prp-irp", (Atom(_X, p, _X),), None)
        for p in self.typed(v.ASYMMETRIC):
            body = (Atom(_X, p, _Y), Atom(_Y, p, _X))
            yield self._about(v.ASYMMETRIC, p, "prp-asyp", body, None)
        yield Rule("eq-diff1", (Atom(_X, v.DIFFERENT, _X),), None)
        yield Rule("cls-nothing2", (_type(v.NOTHING, _X),), None)

    def _about(
        self, kind: int, p: int, name: str, body: tuple[Atom, ...], head: Atom | None
    ) -> Rule:
        return Rule(name, body, head, ((p, v.TYPE, kind),))

    def _equal(
        self, name: str, body: tuple[Atom, ...], a: int, b: int, because: tuple[Fact, ...]
    ) -> Iterator[Rule]:
        """A rule that makes two things one, and the check that they can be."""
        links = [atom for atom in body if atom.o in (a, b)]
        if not links or not all(self.is_data(link.p) for link in links):
            yield Rule(name, body, Atom(a, v.SAME, b), because, (Differ(a, b),))
        if links:
            yield Rule(name, body, None, because, (Clash(a, b),))

    def inverses_and_chains(self) -> Iterator[Rule]:
        for p, q in sorted(self.view.pairs(v.INVERSE_OF)):
            because: tuple[Fact, ...] = ((p, v.INVERSE_OF, q),)
            yield Rule("prp-inv1", (Atom(_X, p, _Y),), Atom(_Y, q, _X), because)
            if p != q:
                yield Rule("prp-inv2", (Atom(_X, q, _Y),), Atom(_Y, p, _X), because)
        for p in sorted({p for p, _ in self.view.pairs(v.CHAIN)}):
            for links, because in self.members(p, v.CHAIN):
                body = tuple(Atom(-i - 1, q, -i - 2) for i, q in enumerate(links))
                if body:
                    head = Atom(-1, p, -len(links) - 1)
                    yield Rule("prp-spo2", body, head, because)

    # Table 6: class expressions.

    def lists_of_classes(self) -> Iterator[Rule]:
        for c in sorted({c for c, _ in self.view.pairs(v.INTERSECTION)}):
            for parts, because in self.members(c, v.INTERSECTION):
                if any(self.is_literal_class(d) for d in parts):
                    continue
                body = tuple(_type(d, _X) for d in parts if d != v.THING)
                if body:
                    yield Rule("cls-int1", body, _type(c, _X), because)
                for d in parts:
                    if d not in (c, v.THING):
                        yield Rule("scm-int", (), Atom(c, v.SUB_CLASS, d), because)
        for c in sorted({c for c, _ in self.view.pairs(v.UNION)}):
            for parts, because in self.members(c, v.UNION):
                if any(self.is_literal_class(d) for d in parts):
                    continue
                for d in parts:
                    if d not in (c, v.NOTHING):
                        yield Rule("scm-uni", (), Atom(d, v.SUB_CLASS, c), because)
        for c in sorted({c for c, _ in self.view.pairs(v.ONE_OF)}):
            for individuals, because in self.members(c, v.ONE_OF):
                for i in individuals:
                    if i < v.LITERAL:
                        yield Rule("cls-oo", (), _type(c, i), because)
        for c, d in sorted(self.view.pairs(v.COMPLEMENT)):
            body = (_type(c, _X), _type(d, _X))
            yield Rule("cls-com", body, None, ((c, v.COMPLEMENT, d),))

    def restrictions(self) -> Iterator[Rule]:
        for r, p in sorted(self.view.pairs(v.ON_PROPERTY)):
            on = (r, v.ON_PROPERTY, p)
            link = Atom(_X, p, _Y)
            for c in sorted(self.view.objects(v.SOME, r)):
                yield from self._some(r, c, link, (on, (r, v.SOME, c)))
            for c in sorted(self.view.objects(v.ALL, r)):
                yield from self._only(r, c, link, (on, (r, v.ALL, c)))
            for value in sorted(self.view.objects(v.HAS_VALUE, r)):
                because = (on, (r, v.HAS_VALUE, value))
                yield Rule("cls-hv1", (_type(r, _X),), Atom(_X, p, value), because)
                yield Rule("cls-hv2", (Atom(_X, p, value),), _type(r, _X), because)
            for kind, name in ((v.MAX, "cls-maxc"), (v.MAX_QUALIFIED, "cls-maxqc")):
                for limit in sorted(self.view.objects(kind, r)):
                    yield from self._at_most(r, link, kind, limit, name, on)

        if self.view.subjects(v.SOME, v.THING) or self.view.subjects(v.ALL, v.THING):
            for c in self.typed(v.CLASS):
                if c not in (v.THING, v.NOTHING):
                    yield Rule("scm-cls", (), Atom(c, v.SUB_CLASS, v.THING))

    def _some(self, r: int, c: int, link: Atom, because: tuple[Fact, ...]) -> Iterator[Rule]:
        if c in (v.THING, v.RDFS_LITERAL):
            yield Rule("cls-svf2", (link,), _type(r, _X), because)
        elif not self.is_literal_class(c):
            yield Rule("cls-svf1", (link, _type(c, _Y)), _type(r, _X), because)
        elif c in v.DATATYPES.values():
            inside = (InDatatype(_Y, c),)
            yield Rule("cls-svf1", (link,), _type(r, _X), because, inside)

    def _only(self, r: int, c: int, link: Atom, because: tuple[Fact, ...]) -> Iterator[Rule]:
        body = (_type(r, _X), link)
        if not self.is_literal_class(c):
            if c != v.THING:
                yield Rule("cls-avf", body, _type(c, _Y), because)
        elif c in v.DATATYPES.values():
            outside = (InDatatype(_Y, c, inside=False),)
            yield Rule("dt-not-type", body, None, because, outside)

    def _at_most(
        self, r: int, link: Atom, kind: int, limit: int, name: str, on: Fact
    ) -> Iterator[Rule]:
        number = self.terms.value(limit).order if limit >= v.LITERAL else None
        classes: list[int | None] = [None]
        if kind == v.MAX_QUALIFIED:
            classes = list(self.view.objects(v.ON_CLASS, on[0]))
        for c in classes:
            because: tuple[Fact, ...] = (on, (r, kind, limit))
            filler = c if c not in (None, v.THING) else None
            if c is not None:
                because = (*because, (r, v.ON_CLASS, c))
            # cls-maxqc1 and 3 name a class, 2 and 4 owl:Thing; cls-maxc1 and 2 neither.
            first, second = ("1", "2") if c is None else ("1", "3") if filler else ("2", "4")
            body = (_type(r, _X), link, *((_type(filler, _Y),) if filler is not None else ()))
            if number == 0:
                yield Rule(name + first, body, None, because)
            elif number == 1:
                other: tuple[Atom, ...] = (Atom(_X, link.p, _Z),)
                if filler is not None:
                    other = (*other, _type(filler, _Z))
                yield from self._equal(name + second, (*body, *other), _Y, _Z, because)

    def keys(self) -> Iterator[Rule]:
        for c in sorted({c for c, _ in self.view.pairs(v.HAS_KEY)}):
            for properties, because in self.members(c, v.HAS_KEY):
                body = [_type(c, _X), _type(c, _Y)]
                for i, p in enumerate(properties):
                    body += [Atom(_X, p, -3 - i), Atom(_Y, p, -3 - i)]
                if properties:
                    head = Atom(_X, v.SAME, _Y)
                    yield Rule("prp-key", tuple(body), head, because, (Differ(_X, _Y),))

    # Checks.

    def disjoint(self) -> Iterator[Rule]:
        for c, d in sorted(self.view.pairs(v.DISJOINT_CLASS)):
            body = (_type(c, _X), _type(d, _X))
            yield Rule("cax-dw", body, None, ((c, v.DISJOINT_CLASS, d),))
        for p, q in sorted(self.view.pairs(v.DISJOINT_PROPERTY)):
            shared = (Atom(_X, p, _Y), Atom(_X, q, _Y))
            yield Rule("prp-pdw", shared, None, ((p, v.DISJOINT_PROPERTY, q),))
        for axiom in self.typed(v.ALL_DISJOINT_CLASSES):
            for classes, because in self.members(axiom, v.MEMBERS):
                for i, c in enumerate(classes):
                    for d in classes[i + 1 :]:
                        yield Rule("cax-adc", (_type(c, _X), _type(d, _X)), None, because)
        for axiom in self.typed(v.ALL_DISJOINT_PROPERTIES):
            for properties, because in self.members(axiom, v.MEMBERS):
                for i, p in enumerate(properties):
                    for q in properties[i + 1 :]:
                        yield Rule("prp-adp", (Atom(_X, p, _Y), Atom(_X, q, _Y)), None, because)

    def negative_assertions(self) -> Iterator[Rule]:
        for name, target in (("prp-npa1", v.TARGET_INDIVIDUAL), ("prp-npa2", v.TARGET_VALUE)):
            for axiom, value in sorted(self.view.pairs(target)):
                for s in sorted(self.view.objects(v.SOURCE, axiom)):
                    for p in sorted(self.view.objects(v.ASSERTION_PROPERTY, axiom)):
                        because = (
                            (axiom, v.SOURCE, s),
                            (axiom, v.ASSERTION_PROPERTY, p),
                            (axiom, target, value),
                        )
                        yield Rule(name, (Atom(s, p, value),), None, because)

    def all_different(self) -> None:
        for axiom in self.typed(v.ALL_DIFFERENT):
            for p, name in ((v.MEMBERS, "eq-diff2"), (v.DISTINCT_MEMBERS, "eq-diff3")):
                for _, because in self.members(axiom, p):
                    items = tuple(fact for fact in because if fact[1] == v.FIRST)
                    self.out.distinct.append(Distinct(name, items, because))

    def types_as_owl_thing(self) -> Iterator[Rule]:
        """Types as owl:Thing, only where an axiom asks for them (cls-thing, scm-cls)."""
        thing = _type(v.THING, _X)
        if not any(thing.key == atom.key for rule in self.out.rules for atom in rule.body):
            return
        for c in self.typed(v.CLASS):
            if c not in (v.THING, v.NOTHING):
                yield Rule("scm-cls", (_type(c, _X),), thing)
        for p in self.typed(v.OBJECT_PROPERTY):
            yield Rule("scm-op", (Atom(_X, p, _Y),), thing)
            yield Rule("scm-op", (Atom(_Y, p, _X),), thing)


def _type(c: int, x: int) -> Atom:
    return Atom(x, v.TYPE, c)


def _reduced(view: View, p: int) -> list[tuple[int, int]]:
    """Return the edges of a transitively closed relation that the others do not imply.

    Equivalent terms keep the ring of edges in the order of their ids, so that each reaches all.
    """
    edges: list[tuple[int, int]] = []
    up: dict[int, set[int]] = {}
    for a, b in view.pairs(p):
        if a != b:
            up.setdefault(a, set()).add(b)
    none: set[int] = set()
    for a, above in sorted(up.items()):
        equal = {b for b in above if a in up.get(b, none)}
        if equal:
            ring = sorted((a, *equal))
            edges.append((a, ring[(ring.index(a) + 1) % len(ring)]))
            if a != ring[0]:
                continue  # what is above the ring hangs on its first member
        if view.work is not None:
            view.work.count(len(above) + sum(len(up.get(b, none)) for b in above))
        strict = above - equal
        implied = {c for b in strict for c in up.get(b, none) if b not in up.get(c, none)}
        for b in sorted(strict - implied):
            twins = {c for c in strict if c != b and b in up.get(c, none)}
            if not twins or b < min(twins):
                edges.append((a, b))
    return edges
