"""Contradictions: what the rules with head `false` of OWL 2 Profiles 4.3 find."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from .dictionary import Dictionary, Fact, Triple
from .equality import Equality
from .relations import Layer
from .rules import Atom, Clash, Rule, View, ground, keys_of, solve
from .strata import Program
from .vocabulary import LITERAL, SAME, TYPE

MESSAGES = {
    "cax-dw": "a member of two disjoint classes",
    "cax-adc": "a member of two classes of a disjoint list",
    "cls-com": "a member of a class and of its complement",
    "cls-nothing2": "a member of owl:Nothing",
    "cls-maxc1": "a value where none is allowed",
    "cls-maxqc1": "a value of a class where none is allowed",
    "cls-maxqc2": "a value where none is allowed",
    "dt-not-type": "a literal outside its datatype or outside the range of the property",
    "eq-diff1": "one thing is said to be different from itself",
    "eq-diff2": "two members of a list of different things are the same",
    "eq-diff3": "two members of a list of different things are the same",
    "prp-adp": "two properties of a disjoint list between the same two things",
    "prp-asyp": "an asymmetric property both ways",
    "prp-fp": "a functional property with two values that cannot be the same",
    "prp-irp": "an irreflexive property between a thing and itself",
    "prp-npa1": "a statement that is denied",
    "prp-npa2": "a statement that is denied",
    "prp-pdw": "two disjoint properties between the same two things",
    "cls-maxc2": "two values that cannot be the same where one is allowed",
    "cls-maxqc3": "two values that cannot be the same where one is allowed",
    "cls-maxqc4": "two values that cannot be the same where one is allowed",
}

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


@dataclass(frozen=True, slots=True)
class Contradiction:
    """Statements that cannot all be true.

    Attributes
    ----------
    rule : str
        Name of the check in OWL 2 Profiles 4.3.
    triples : tuple of Triple
        The instance statements that clash; each can be explained.
    axioms : tuple of Triple
        The schema statements that forbid it.
    message : str
    """

    rule: str
    triples: tuple[Triple, ...]
    axioms: tuple[Triple, ...]
    message: str

    def __str__(self) -> str:
        return self.message


def find_all(view: View, terms: Dictionary, program: Program) -> Iterator[Inconsistency]:
    """Yield what every check finds in a view."""
    for rule in program.checks.rules:
        yield from _instances(rule, view, terms)


def find_new(layer: Layer, terms: Dictionary, program: Program) -> Iterator[Inconsistency]:
    """Yield what the checks find with at least one fact that the layer adds."""
    checks = program.checks
    for fact in layer.added:
        for key in keys_of(fact):
            for trigger in checks.triggers.get(key, ()):
                for env in trigger.fire(layer, terms, fact):
                    yield _finding(trigger.rule, env)


def find_equal(program: Program, equality: Equality) -> Iterator[Inconsistency]:
    """Yield members of lists of different things that are the same (eq-diff2, eq-diff3)."""
    for different in program.distinct:
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
    single_valued = _is_functional(body) and isinstance(rule.conditions[0], Clash)
    env = rule.environment()
    if single_valued:
        first = body[0]
        for s in {s for s, _ in view.pairs(first.p)}:
            if len(view.objects(first.p, s)) > 1:
                env[~first.s] = s
                for found in solve(view, terms, rule.steps, env):
                    yield _finding(rule, found)
        return
    for found in solve(view, terms, rule.steps, env):
        yield _finding(rule, found)


def _is_functional(body: tuple[Atom, ...]) -> bool:
    if len(body) != 2:
        return False
    a, b = body
    return a.p == b.p and a.s == b.s < 0 and a.o != b.o and max(a.o, b.o) < 0


def describe(
    finding: Inconsistency, terms: Dictionary, asserted_form: Callable[[Fact], Fact]
) -> Contradiction:
    """Turn a finding into terms, each premise in a form that was asserted if there is one."""
    facts = [asserted_form(fact) for fact in finding.premises]
    if finding.rule in LISTED:
        facts = [(facts[0][2], SAME, facts[1][2])]
    triples = tuple(sorted(map(terms.decode_fact, facts), key=str))
    axioms = tuple(terms.decode_fact(asserted_form(fact)) for fact in finding.because)
    what = MESSAGES.get(finding.rule, "a clash")
    said = "; ".join(" ".join(str(term) for term in triple) for triple in triples)
    return Contradiction(finding.rule, triples, axioms, f"{what} ({finding.rule}): {said}")
