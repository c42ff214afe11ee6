"""Checks: instances of the rules with head `false` of OWL 2 Profiles 4.3."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from reasoner.facts.equality import Equality
from reasoner.facts.layer import Layer
from reasoner.rules.rule import Clash, Rule, View, ground, keys_of, solve
from reasoner.rules.strata import Program
from reasoner.terms.dictionary import Dictionary, Fact
from reasoner.terms.vocabulary import LITERAL, TYPE

LISTED = frozenset({"eq-diff2", "eq-diff3"})
"""Checks over whole lists; their premises are the two places in the list."""


@dataclass(frozen=True, slots=True)
class Inconsistency:
    """A contradiction over ids.

    Attributes
    ----------
    rule : str
    premises : tuple of Fact
        Facts that clash, on representatives.
    because : tuple of Fact
        Schema facts behind the check.
    """

    rule: str
    premises: tuple[Fact, ...]
    because: tuple[Fact, ...]

    @property
    def identity(self) -> tuple[str, frozenset[Fact], tuple[Fact, ...]]:
        """Equal for two findings that differ in the order of their premises only."""
        return self.rule, frozenset(self.premises), self.because


_FINDING_WORK = 10
"""Candidates that recording a contradiction counts as."""


def find_all(view: View, terms: Dictionary, checks: Iterable[Rule]) -> Iterator[Inconsistency]:
    """Yield all that checks find in a view."""
    for rule in checks:
        for finding in _instances(rule, view, terms):
            if view.work is not None:
                view.work.count(_FINDING_WORK)
            yield finding


def find_new(layer: Layer, terms: Dictionary, program: Program) -> Iterator[Inconsistency]:
    """Yield what the checks find with at least one fact that the layer adds."""
    checks = program.checks
    for fact in layer.added:
        for key in keys_of(fact):
            for trigger in checks.triggers.get(key, ()):
                for env in trigger.fire(layer, terms, fact):
                    if layer.work is not None:
                        layer.work.count(_FINDING_WORK)
                    yield _finding(trigger.rule, env)


def find_equal(program: Program, equality: Equality) -> Iterator[Inconsistency]:
    """Yield members of lists of different things that are the same (eq-diff2, eq-diff3)."""
    # With no equal terms, the lists alone decide.
    for different in program.distinct if equality else program.repeating:
        seen: dict[int, Fact] = {}
        for fact in map(equality.rewrite, different.items):
            other = seen.setdefault(fact[2], fact)
            if other != fact:
                yield Inconsistency(different.name, (other, fact), different.because)


def find_ill_typed(facts: Iterable[Fact], terms: Dictionary) -> Iterator[Inconsistency]:
    """Yield asserted facts whose literal does not belong to its datatype (dt-not-type)."""
    for fact in facts:
        if fact[2] >= LITERAL and not terms.value(fact[2]).well_typed:
            yield Inconsistency("dt-not-type", (fact,), ())


def _finding(rule: Rule, env: list[int | None]) -> Inconsistency:
    premises = tuple(dict.fromkeys(ground(atom, env) for atom in rule.body))
    return Inconsistency(rule.name, premises, rule.because)


def _instances(rule: Rule, view: View, terms: Dictionary) -> Iterator[Inconsistency]:
    """Find all instances of a check; the two frequent shapes take a shortcut over whole sets."""
    body = rule.body
    if len(body) == 2 and all(a.p == TYPE and a.s < 0 and a.o >= 0 for a in body):
        for x in view.subjects(TYPE, body[0].o) & view.subjects(TYPE, body[1].o):
            env = rule.environment()
            env[~body[0].s] = x
            yield _finding(rule, env)
        return
    env = rule.environment()
    if _is_single_valued(rule):
        first = body[0]
        # Few subjects have two values; only those are joined.
        for s in {s for s, _ in view.pairs(first.p)}:
            if len(view.objects(first.p, s)) > 1:
                env[~first.s] = s
                for bindings in solve(view, terms, rule.steps, env):
                    yield _finding(rule, bindings)
        return
    for bindings in solve(view, terms, rule.steps, env):
        yield _finding(rule, bindings)


def _is_single_valued(rule: Rule) -> bool:
    """Tell whether a check is about two values of one subject that clash."""
    if len(rule.body) != 2 or not any(isinstance(c, Clash) for c in rule.conditions):
        return False
    a, b = rule.body
    return a.p == b.p and a.s == b.s < 0 and a.o != b.o and max(a.o, b.o) < 0
