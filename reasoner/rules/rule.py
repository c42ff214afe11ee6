"""Rules as data: atoms over ids, conditions, and the order in which a rule's parts are matched."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple, Protocol, runtime_checkable

from reasoner.terms.dictionary import Dictionary, Fact
from reasoner.terms.vocabulary import LITERAL, TYPE

Bindings = list[int | None]
"""Value of variable v at index `~v`; None while unbound."""


class Atom(NamedTuple):
    """A triple pattern with a constant predicate; negative subject and object are variables."""

    s: int
    p: int
    o: int

    @property
    def variables(self) -> frozenset[int]:
        """The variables of the atom."""
        return frozenset(x for x in (self.s, self.o) if x < 0)

    @property
    def key(self) -> int:
        """Index key of the atom: its predicate, or `~class` for a type with known class."""
        return ~self.o if self.p == TYPE and self.o >= 0 else self.p


def keys_of(fact: Fact) -> tuple[int, ...]:
    """Return the keys of all atoms that may match a fact."""
    _, p, o = fact
    # A type is filed under its class as well: rdf:type alone would wake every rule at every new
    # member.
    return (~o, p) if p == TYPE else (p,)


class Counter(Protocol):
    """Protocol of what counts the candidates of joins."""

    def spend(self, candidates: int, steps: Sequence[Step]) -> None:
        """Count candidates of one step of a rule; raises where they are too many."""

    def count(self, candidates: int, rule: Rule | None = None) -> None:
        """Count other work; raises where it is too much."""


class View(Protocol):
    """Protocol of a set of facts that rules are matched against."""

    @property
    def work(self) -> Counter | None:
        """Counter of the candidates of joins, if they are bounded."""

    def has(self, s: int, p: int, o: int) -> bool:
        """Tell whether a fact holds."""

    def objects(self, p: int, s: int) -> frozenset[int] | set[int]:
        """Return the objects of a subject."""

    def subjects(self, p: int, o: int) -> frozenset[int] | set[int]:
        """Return the subjects of an object."""

    def pairs(self, p: int) -> Iterator[tuple[int, int]]:
        """Iterate over subject and object of a property."""

    def size(self, p: int) -> int:
        """Return about how many facts a property has."""


@runtime_checkable
class Condition(Protocol):
    """A test on bound variables; may bind one more (`BIND`)."""

    @property
    def needs(self) -> frozenset[int]:
        """Variables that must be bound before the test."""

    @property
    def gives(self) -> frozenset[int]:
        """Variables that the test binds."""

    def holds(self, view: View, terms: Dictionary, env: Bindings) -> bool:
        """Tell whether the condition holds."""


Step = Atom | Condition


@dataclass(frozen=True, slots=True)
class Differ:
    """Two variables are bound to different ids."""

    left: int
    right: int
    gives: frozenset[int] = frozenset()

    @property
    def needs(self) -> frozenset[int]:
        """Both variables."""
        return frozenset((self.left, self.right))

    def holds(self, view: View, terms: Dictionary, env: Bindings) -> bool:
        """Compare the two bindings."""
        return env[~self.left] != env[~self.right]


@dataclass(frozen=True, slots=True)
class Clash:
    """Two variables cannot denote one thing: a literal and a resource, or two known values."""

    left: int
    right: int
    gives: frozenset[int] = frozenset()

    @property
    def needs(self) -> frozenset[int]:
        """Both variables."""
        return frozenset((self.left, self.right))

    def holds(self, view: View, terms: Dictionary, env: Bindings) -> bool:
        """Compare the two bindings by value."""
        a, b = env[~self.left], env[~self.right]
        assert a is not None
        assert b is not None
        return terms.is_clash(a, b)


@dataclass(frozen=True, slots=True)
class InDatatype:
    """A variable is bound to a literal inside (or, negated, outside) a datatype.

    A literal of which this is not known is neither.
    """

    variable: int
    datatype: int
    inside: bool = True
    gives: frozenset[int] = frozenset()

    @property
    def needs(self) -> frozenset[int]:
        """The variable."""
        return frozenset((self.variable,))

    def holds(self, view: View, terms: Dictionary, env: Bindings) -> bool:
        """Tell whether it holds of the binding."""
        bound = env[~self.variable]
        assert bound is not None
        return self.holds_of(bound, terms)

    def holds_of(self, bound: int, terms: Dictionary) -> bool:
        """Look the datatype up in the literal's mask; resources lie in no datatype."""
        # Ids of literals lie above all others, so that this is a comparison of integers.
        if bound < LITERAL:
            return not self.inside
        return terms.in_datatype(bound, self.datatype) is self.inside


@dataclass(frozen=True)
class Absent:
    """NOT EXISTS: the group has no solution (SPARQL 1.1 Query 8.1.1)."""

    atoms: tuple[Atom, ...]
    conditions: tuple[Condition, ...]
    outer: frozenset[int]
    """Variables shared with the patterns around the group."""
    gives: frozenset[int] = frozenset()

    @property
    def needs(self) -> frozenset[int]:
        """The shared variables."""
        return self.outer

    @property
    def sees_identity(self) -> bool:
        """Whether a condition of the group does."""
        return any(getattr(c, "sees_identity", False) for c in self.conditions)

    @cached_property
    def steps(self) -> tuple[Step, ...]:
        """The group in matching order."""
        return arrange(self.atoms, self.conditions, self.outer)

    def holds(self, view: View, terms: Dictionary, env: Bindings) -> bool:
        """Return whether the group has no solution."""
        # Kept where the view does not change meanwhile: many bindings ask the same question.
        answers: dict[tuple[int | None, ...], bool] | None = getattr(view, "absences", None)
        if answers is None:
            return self._is_absent(view, terms, env)
        question = (id(self), *(env[~v] for v in self._ordered_outer))
        answer = answers.get(question)
        if answer is None:
            answer = answers[question] = self._is_absent(view, terms, env)
        return answer

    def _is_absent(self, view: View, terms: Dictionary, env: Bindings) -> bool:
        inner: Bindings = [None] * len(env)
        for v in self.outer:
            inner[~v] = env[~v]
        return not _is_solvable(view, terms, self.steps, inner, 0)

    @cached_property
    def _ordered_outer(self) -> tuple[int, ...]:
        return tuple(sorted(self.outer))


@dataclass(frozen=True)
class Rule:
    """A Horn rule with conditions.

    Attributes
    ----------
    name : str
        Name in OWL 2 Profiles 4.3, or `rule:<name>` of a user's rule.
    body : tuple of Atom
        Empty for a fact that the schema states.
    head : Atom or None
        None for a check: the body must not hold.
    because : tuple of Fact
        Schema facts the rule was compiled from.
    conditions : tuple of Condition
    names : tuple of str
        Names of the variables of a user-defined rule.
    """

    name: str
    body: tuple[Atom, ...]
    head: Atom | None
    because: tuple[Fact, ...] = ()
    conditions: tuple[Condition, ...] = ()
    names: tuple[str, ...] = field(default=(), compare=False)

    @cached_property
    def width(self) -> int:
        """Number of variables."""
        lowest = 0
        for atom in (*self.body, *((self.head,) if self.head else ())):
            lowest = min(lowest, atom.s, atom.o)
        return max(-lowest, *(_width(c) for c in self.conditions), 0)

    @cached_property
    def steps(self) -> tuple[Step, ...]:
        """Body and conditions in matching order, nothing bound."""
        return arrange(self.body, self.conditions, frozenset())

    def backward_steps(self, fact: Fact) -> tuple[Step, ...]:
        """Return body and conditions in matching order for a fact that the head is bound to."""
        return self._backward_to_value if fact[2] >= LITERAL else self._backward_to_thing

    @cached_property
    def _backward_to_thing(self) -> tuple[Step, ...]:
        bound = self.head.variables if self.head else frozenset()
        return arrange(self.body, self.conditions, bound)

    @cached_property
    def _backward_to_value(self) -> tuple[Step, ...]:
        assert self.head is not None
        # All hands of a fleet may have one payload: begun there, what one robot lifted is looked
        # for among the attempts of all, which grow with the store.
        values = frozenset((self.head.o,)) - {self.head.s}
        return arrange(self.body, self.conditions, self.head.variables, values)

    @property
    def absences(self) -> tuple[Absent, ...]:
        """The rule's own NOT EXISTS groups."""
        return tuple(c for c in self.conditions if isinstance(c, Absent))

    @cached_property
    def sees_identity(self) -> bool:
        """Whether the rule may cease to hold when two terms turn out to be the same."""
        return any(getattr(c, "sees_identity", False) for c in self.conditions)

    def substitute(self, other: dict[int, int]) -> Rule:
        """Return the rule with some terms of its atoms and schema facts replaced."""

        def replaced(atom: Atom) -> Atom:
            return Atom(*(other.get(x, x) for x in atom))

        return replace(
            self,
            body=tuple(map(replaced, self.body)),
            head=replaced(self.head) if self.head else None,
            because=tuple(
                (other.get(s, s), other.get(p, p), other.get(o, o)) for s, p, o in self.because
            ),
        )

    def environment(self) -> Bindings:
        """Return bindings with every variable unbound."""
        return [None] * self.width

    def conclude(self, env: Bindings) -> Fact:
        """Return the head under bindings."""
        assert self.head is not None
        return ground(self.head, env)


def _width(condition: Condition) -> int:
    own = max((-v for v in condition.needs | condition.gives), default=0)
    if isinstance(condition, Absent):
        own = max(own, *(-v for a in condition.atoms for v in a.variables), 0)
        own = max(own, *(_width(c) for c in condition.conditions), 0)
    return own


def ground(atom: Atom, env: Bindings) -> Fact:
    """Return an atom under bindings of all its variables."""
    s, p, o = atom
    a = env[~s] if s < 0 else s
    b = env[~o] if o < 0 else o
    assert a is not None
    assert b is not None
    return a, p, b


def arrange(
    atoms: Iterable[Atom],
    conditions: Iterable[Condition],
    bound: frozenset[int],
    values: frozenset[int] = frozenset(),
) -> tuple[Step, ...]:
    """Order atoms most-bound-first, each condition as soon as its variables are bound.

    Of two atoms with one bound end, that of a known variable comes first: a constant such as `true`
    may have thousands of subjects, and so may a variable that is bound to a literal.

    Parameters
    ----------
    bound
        Variables that are bound before.
    values
        Those of them that are bound to literals.

    >>> chain = (Atom(-2, 300, -3), Atom(-1, 301, -2))
    >>> [atom.p for atom in arrange(chain, (), frozenset({-1}))]
    [301, 300]
    >>> flagged = (Atom(-2, 300, 99), Atom(-2, 301, -1))
    >>> [atom.p for atom in arrange(flagged, (), frozenset({-1}))]
    [301, 300]
    >>> two_ends = (Atom(-3, 300, -2), Atom(-3, 301, -1))
    >>> [atom.p for atom in arrange(two_ends, (), frozenset({-1, -2}), frozenset({-2}))]
    [301, 300]
    """
    left, waiting, settled = list(atoms), list(conditions), set(bound)
    steps: list[Step] = []

    def place_conditions() -> None:
        progress = True
        while progress:
            progress = False
            for condition in list(waiting):
                if condition.needs <= settled:
                    steps.append(condition)
                    settled.update(condition.gives)
                    waiting.remove(condition)
                    progress = True

    place_conditions()
    while left:
        # Greedy: bodies have a handful of atoms, and an order by actual sizes would have to be
        # found anew for each change.
        best = max(left, key=lambda atom: _selectivity(atom, settled, values))
        left.remove(best)
        steps.append(best)
        settled |= best.variables
        place_conditions()
    if waiting:
        # SPARQL: a filter on an unbound variable is an error, hence false.
        steps += waiting
    return tuple(steps)


def _selectivity(atom: Atom, bound: set[int], values: frozenset[int]) -> tuple[int, int, bool]:
    has_bound = [x in bound and x not in values for x in (atom.s, atom.o)]
    is_bound = [x >= 0 or x in bound for x in (atom.s, atom.o)]
    if atom.p == TYPE and atom.s < 0 and not is_bound[0] and atom.o >= 0:
        return 0, 0, True  # a whole class is seldom a good start
    return sum(is_bound), sum(has_bound), is_bound[0]


def bind(atom: Atom, fact: Fact, terms: Dictionary, env: Bindings) -> bool:
    """Bind an atom's variables to a fact with the same predicate; False if constants differ."""
    for pattern, value in ((atom.s, fact[0]), (atom.o, fact[2])):
        if pattern >= 0:
            if pattern != value and not terms.is_same(pattern, value):
                return False
        else:
            present = env[~pattern]
            if present is None:
                env[~pattern] = value
            elif present != value and not terms.is_same(present, value):
                return False
    return True


def _is_solvable(
    view: View, terms: Dictionary, steps: Sequence[Step], env: Bindings, start: int
) -> bool:
    """Return whether the steps from `start` can be satisfied, trying the newest facts first.

    Rules that look for something later, or newer, then find it at once.
    """
    if start == len(steps):
        return True
    step = steps[start]
    if not isinstance(step, Atom) or (step.s < 0 and env[~step.s] is None):
        return next(solve(view, terms, steps, env, start), None) is not None
    s, p, o = step
    a = env[~s] if s < 0 else s
    b = env[~o] if o < 0 else o
    assert a is not None
    if b is not None:
        return any(view.has(a, p, each) for each in terms.variants(b)) and _is_solvable(
            view, terms, steps, env, start + 1
        )
    values = view.objects(p, a)
    if view.work is not None:
        view.work.spend(len(values), steps)
    for value in sorted(values, reverse=True):
        env[~o] = value
        if _is_solvable(view, terms, steps, env, start + 1):
            return True
    env[~o] = None
    return False


def solve(
    view: View, terms: Dictionary, steps: Sequence[Step], env: Bindings, start: int = 0
) -> Iterator[Bindings]:
    """Yield `env` once per way to fulfil the steps from `start`; it is filled in place.

    The view must not change while the iterator is in use.
    """
    if start == len(steps):
        yield env
        return
    step = steps[start]
    if not isinstance(step, Atom):
        before = [(v, env[~v]) for v in step.gives]
        if step.holds(view, terms, env):
            yield from solve(view, terms, steps, env, start + 1)
        for v, old in before:
            env[~v] = old
        return
    s, p, o = step
    a = env[~s] if s < 0 else s
    b = env[~o] if o < 0 else o
    work = view.work
    if a is not None:
        if b is not None:
            if any(view.has(a, p, each) for each in terms.variants(b)):
                yield from solve(view, terms, steps, env, start + 1)
            return
        values = tuple(view.objects(p, a))
        if work is not None:
            work.spend(len(values), steps)
        for value in values:
            env[~o] = value
            yield from solve(view, terms, steps, env, start + 1)
        env[~o] = None
        return
    if b is not None:
        for each in terms.variants(b):
            values = tuple(view.subjects(p, each))
            if work is not None:
                work.spend(len(values), steps)
            for value in values:
                env[~s] = value
                yield from solve(view, terms, steps, env, start + 1)
        env[~s] = None
        return
    pairs = tuple(view.pairs(p))
    if work is not None:
        work.spend(len(pairs), steps)
    if s == o:
        for value, other in pairs:
            if value == other:
                env[~s] = value
                yield from solve(view, terms, steps, env, start + 1)
        env[~s] = None
    else:
        for value, other in pairs:
            env[~s], env[~o] = value, other
            yield from solve(view, terms, steps, env, start + 1)
        env[~s] = env[~o] = None
