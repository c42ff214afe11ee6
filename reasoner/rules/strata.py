"""Programs: rules indexed by the facts that trigger them, in layers that negation does not cross.

A rule belongs to the layer of its head, which lies above the layer of everything its NOT EXISTS
groups mention (stratified negation; Apt, Blair and Walker 1988).
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

from reasoner.rules.compile import Distinct
from reasoner.rules.rule import Absent, Atom, Rule, Step, View, arrange, bind, solve
from reasoner.terms.dictionary import Dictionary, Fact
from reasoner.terms.vocabulary import RESERVED, SAME, SCHEMA_PREDICATES, TYPE

Projection = tuple[int, int, int]
"""Head of a rule with one plain body atom: -1 is its subject, -2 its object, else a constant."""


class StratificationError(ValueError):
    """The rules negate their own results, or compute values from values that they produced.

    The message shows the cycle.
    """


@dataclass(frozen=True)
class Trigger:
    """A rule together with the body atom that a changed fact matches."""

    rule: Rule
    atom: Atom

    @cached_property
    def steps(self) -> tuple[Step, ...]:
        """Other conditions of the rule, in matching order."""
        rest = list(self.rule.body)
        rest.remove(self.atom)
        return arrange(rest, self.rule.conditions, self.atom.variables)

    def fire(self, view: View, terms: Dictionary, fact: Fact) -> Iterator[list[int | None]]:
        """Yield the bindings of all instances of the rule that use the fact."""
        env = self.rule.environment()
        if bind(self.atom, fact, terms, env):
            yield from solve(view, terms, self.steps, env)

    def unconditional(
        self, view: View, terms: Dictionary, fact: Fact
    ) -> Iterator[list[int | None]]:
        """Yield the instances that use the fact, whether or not the conditions hold."""
        env = self.rule.environment()
        if bind(self.atom, fact, terms, env):
            yield from solve(view, terms, self.bare_steps, env)

    @cached_property
    def bare_steps(self) -> tuple[Step, ...]:
        """The other atoms alone, in matching order."""
        rest = list(self.rule.body)
        rest.remove(self.atom)
        return arrange(rest, (), self.atom.variables)

    @cached_property
    def is_bound_by_atoms(self) -> bool:
        """Whether the atoms alone determine the head."""
        head = self.rule.head
        return head is not None and head.variables <= {
            v for atom in self.rule.body for v in atom.variables
        }


@dataclass(frozen=True)
class AbsenceTrigger:
    """A rule together with an atom inside one of its NOT EXISTS groups."""

    rule: Rule
    atom: Atom
    path: tuple[Absent, ...]
    """The groups around the atom, outermost first."""

    @cached_property
    def steps(self) -> tuple[Step, ...]:
        """The rule's atoms and those of the groups around the atom."""
        atoms = [*self.rule.body, *(a for group in self.path for a in group.atoms)]
        atoms.remove(self.atom)
        return arrange(atoms, (), self.atom.variables)

    @property
    def is_negative(self) -> bool:
        """Whether a fact that matches speaks against the rule, and not for it."""
        return len(self.path) % 2 == 1

    @cached_property
    def steps_to_head(self) -> tuple[tuple[Step, ...], tuple[Step, ...]]:
        """The head among the other atoms, in matching order: the steps up to it, and those after.

        If the fact binds no variable of the head, atoms that lead to the head come first: the rule
        may have drawn many conclusions, few of which are related to the fact.
        """
        head = self.rule.head
        assert head is not None
        atoms = [*self.rule.body, *(a for group in self.path for a in group.atoms)]
        atoms.remove(self.atom)
        steps = arrange([head, *atoms], (), self.atom.variables)
        place = next(i for i, step in enumerate(steps) if step is head)
        return steps[: place + 1], steps[place + 1 :]

    def held(self, view: View, terms: Dictionary, fact: Fact) -> Iterator[Fact]:
        """Yield conclusions that hold and that a fact may speak against."""
        env = self.rule.environment()
        if self.rule.head is None or not bind(self.atom, fact, terms, env):
            return
        before, after = self.steps_to_head
        seen = set()
        for bindings in solve(view, terms, before, env):
            conclusion = self.rule.conclude(bindings)
            if conclusion in seen:
                continue
            if next(solve(view, terms, after, list(bindings)), None) is not None:
                seen.add(conclusion)
                yield conclusion

    def candidates(self, view: View, terms: Dictionary, fact: Fact) -> Iterator[list[int | None]]:
        """Yield bindings of the rule's body whose truth the fact may have changed."""
        env = self.rule.environment()
        if not bind(self.atom, fact, terms, env):
            return
        variables = {v for atom in self.rule.body for v in atom.variables}
        seen = set()
        for bindings in solve(view, terms, self.steps, env):
            outer = tuple(x if ~i in variables else None for i, x in enumerate(bindings))
            if outer not in seen:
                seen.add(outer)
                yield list(outer)


class Stratum:
    """Rules of one layer, indexed by the keys of their body atoms and of their heads."""

    def __init__(self, rules: Iterable[Rule]) -> None:
        self.rules = tuple(rules)
        self.projections: dict[int, list[Projection]] = defaultdict(list)
        self.triggers: dict[int, list[Trigger]] = defaultdict(list)
        self.absences: dict[int, list[AbsenceTrigger]] = defaultdict(list)
        for rule in self.rules:
            projection = _projection(rule)
            if projection is not None:
                self.projections[rule.body[0].key].append(projection)
                continue
            for atom in dict.fromkeys(rule.body):
                self.triggers[atom.key].append(Trigger(rule, atom))
            for atom, path in _negated_atoms(rule.absences, ()):
                self.absences[atom.key].append(AbsenceTrigger(rule, atom, path))


def _projection(rule: Rule) -> Projection | None:
    """Return the short form of a rule with one body atom over plain variables."""
    if len(rule.body) != 1 or rule.conditions or rule.head is None or rule.head.p == SAME:
        return None
    (s, p, o), head = rule.body[0], rule.head
    # Rules are found by predicate, or by class: any other constant, and a variable that comes
    # twice, would have to be compared with each fact.
    if s >= 0 or s == o or (o >= 0 and p != TYPE):
        return None

    def slot(x: int) -> int:
        return x if x >= 0 else -1 if x == s else -2

    return slot(head.s), head.p, slot(head.o)


def _negated_atoms(
    groups: Iterable[Absent], path: tuple[Absent, ...]
) -> Iterator[tuple[Atom, tuple[Absent, ...]]]:
    for group in groups:
        inner = (*path, group)
        for atom in group.atoms:
            yield atom, inner
        yield from _negated_atoms((c for c in group.conditions if isinstance(c, Absent)), inner)


class Program:
    """All rules in force: layered, with an index from heads for looking backward.

    Parameters
    ----------
    rules : iterable of Rule
        Deriving rules and checks.
    distinct : iterable of Distinct
        Lists of pairwise different individuals.

    Raises
    ------
    StratificationError
        If a rule negates, directly or not, what it derives.
    """

    def __init__(
        self,
        rules: Iterable[Rule],
        distinct: Iterable[Distinct] = (),
        terms: Dictionary | None = None,
    ) -> None:
        self.rules = tuple(dict.fromkeys(rules))
        self.distinct = tuple(distinct)
        deriving = [rule for rule in self.rules if rule.head is not None]
        require_end(deriving, terms)
        self._levels = _levels(deriving, terms)
        layers: dict[int, list[Rule]] = defaultdict(list)
        for rule in deriving:
            assert rule.head is not None
            layers[self._level_of_key(rule.head.key)].append(rule)
        self.strata = tuple(Stratum(layers[i]) for i in range(max(layers, default=0) + 1))
        self.checks = Stratum(rule for rule in self.rules if rule.head is None)
        self.by_head: dict[int, list[Rule]] = defaultdict(list)
        for rule in deriving:
            assert rule.head is not None
            self.by_head[rule.head.key].append(rule)
        self.constants = frozenset(constants_of(self.rules))

    @cached_property
    def repeating(self) -> tuple[Distinct, ...]:
        """The lists of different individuals that name one of them twice."""
        return tuple(d for d in self.distinct if len({f[2] for f in d.items}) < len(d.items))

    def _level_of_key(self, key: int) -> int:
        return self._levels.get(key, self._levels.get(TYPE, 0) if key < 0 else 0)

    def level(self, fact: Fact) -> int:
        """Return the layer in which facts like this one are derived."""
        if not self._levels:
            return 0
        _, p, o = fact
        return self._level_of_key(~o if p == TYPE else p)

    def level_of(self, atom: Atom) -> int:
        """Return the layer in which facts that match an atom are derived."""
        return self._level_of_key(atom.key)

    def rules_for(self, fact: Fact) -> Iterator[Rule]:
        """Yield the rules whose head may be this fact."""
        _, p, o = fact
        if p == TYPE:
            yield from self.by_head.get(~o, ())
        yield from self.by_head.get(p, ())


def constants_of(rules: Iterable[Rule]) -> Iterator[int]:
    """Yield the terms outside the vocabulary that rules mention, schema facts included."""
    reasons: dict[int, tuple[Fact, ...]] = {}
    for rule in rules:
        atoms = [*rule.body, *(atom for atom, _ in _negated_atoms(rule.absences, ()))]
        for atom in (*atoms, *((rule.head,) if rule.head else ())):
            yield from (x for x in atom if x >= RESERVED)
        # All rules of one axiom share its facts, a long list perhaps.
        reasons[id(rule.because)] = rule.because
    for facts in reasons.values():
        for fact in facts:
            yield from (x for x in fact if x >= RESERVED)


def require_end(rules: Iterable[Rule], terms: Dictionary | None) -> None:
    """Raise where a rule that makes new values (`BIND`) may feed itself through other rules."""
    deriving = [(rule, rule.head) for rule in rules if rule.head is not None]
    minting = [
        (rule, head)
        for rule, head in deriving
        if any(condition.gives & head.variables for condition in rule.conditions)
    ]
    if not minting:
        return
    after: dict[int, set[int]] = defaultdict(set)
    for rule, head in deriving:
        for atom in rule.body:
            after[atom.key].add(head.key)
    for rule, head in minting:
        # Followed whatever the values are, so that some rules that would end are refused as well:
        # whether a rule ends for all data cannot be decided.
        came_from: dict[int, int] = {}
        queue = deque([head.key])
        while queue:
            key = queue.popleft()
            for other in after[key] - came_from.keys():
                came_from[other] = key
                queue.append(other)
        fed = next((atom.key for atom in rule.body if atom.key in (*came_from, head.key)), None)
        if fed is not None:
            raise StratificationError(
                f"{rule.name} makes new values from its own results and would not end: "
                f"{_name(head.key, terms)} <- {_chain(fed, came_from, terms)}"
            )


def _levels(rules: list[Rule], terms: Dictionary | None) -> dict[int, int]:
    """Return the layer of each key above the lowest; empty without negation."""
    if not any(rule.absences or rule.sees_identity for rule in rules):
        return {}
    # A rule with a variable for a class matches facts of any class, which then share one layer.
    generic = any(
        atom.key == TYPE for rule in rules for atom in (*rule.body, rule.head) if atom is not None
    )

    def node(key: int) -> int:
        return TYPE if generic and key < 0 else key

    above: dict[int, set[tuple[int, bool]]] = defaultdict(set)
    for rule in rules:
        assert rule.head is not None
        head = node(rule.head.key)
        for atom in rule.body:
            above[node(atom.key)].add((head, False))
        for atom, _ in _negated_atoms(rule.absences, ()):
            above[node(atom.key)].add((head, True))
        if rule.sees_identity:
            above[SAME].add((head, True))  # "not the same" is an absence of sameAs
    # Each layer but the lowest is there for a rule that negates: more layers than such rules come
    # of a rule that is above itself.
    limit = sum(1 for rule in rules if rule.absences or rule.sees_identity)
    levels: dict[int, int] = {}
    came_from: dict[int, int] = {}
    queue = deque(key for key, edges in above.items() if any(negative for _, negative in edges))
    while queue:
        key = queue.popleft()
        for head, negative in above[key]:
            level = levels.get(key, 0) + negative
            if level > levels.get(head, 0):
                levels[head], came_from[head] = level, key
                if level > limit:
                    raise StratificationError(_circle(head, came_from, terms))
                queue.append(head)
    for key, level in levels.items():
        if level and (key == SAME or key in SCHEMA_PREDICATES):
            raise StratificationError(
                f"{_name(key, terms)} is derived from what a rule negates, and everything is "
                f"derived from it: {_chain(key, came_from, terms)}"
            )
    return levels


def _circle(start: int, came_from: dict[int, int], terms: Dictionary | None) -> str:
    return (
        "negation runs in a circle: "
        + _chain(start, came_from, terms)
        + "; rephrase one of these rules without NOT EXISTS"
    )


def _chain(start: int, came_from: dict[int, int], terms: Dictionary | None) -> str:
    chain = [start]
    while chain[-1] in came_from and came_from[chain[-1]] not in chain:
        chain.append(came_from[chain[-1]])
    if chain[-1] in came_from:
        chain.append(came_from[chain[-1]])
    return " <- ".join(_name(key, terms) for key in chain)


def _name(key: int, terms: Dictionary | None) -> str:
    if terms is None:
        return str(key)
    return f"class {terms.iri(~key)}" if key < 0 else terms.iri(key)
