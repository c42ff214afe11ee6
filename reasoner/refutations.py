"""What would make a statement hold that does not: the rules that come nearest to deriving it.

For each rule with a matching head, the search looks for bindings under which one premise alone is
missing, or none but a condition; failing that, the whole body is missing.
"""

from __future__ import annotations

from collections.abc import Iterator

from reasoner.decisions import Budget, Need, OutOfBudgetError, Refutation
from reasoner.facts.equality import Equality
from reasoner.facts.layer import Layer
from reasoner.facts.relations import Facts
from reasoner.glosses import Glossary, Name
from reasoner.proofs import Expanded
from reasoner.rules.rule import Absent, Atom, Bindings, Rule, arrange, bind, solve
from reasoner.rules.strata import Program
from reasoner.terms.dictionary import Dictionary, Fact

__all__ = ["Refuter"]

MAX_NEEDS = 3
MAX_RULES = 200


class Refuter:
    """Search for what a statement lacks, in one state of a closure."""

    def __init__(
        self,
        facts: Facts | Layer,
        equality: Equality,
        program: Program,
        terms: Dictionary,
        budget: Budget,
        name: Name,
    ) -> None:
        self._view = Expanded(facts, equality, budget)
        self._equality = equality
        self._program = program
        self._terms = terms
        self._glossary = Glossary(self._view, terms, name)

    def refute(self, fact: Fact) -> Refutation:
        """Return that a fact does not hold, and the nearest ways to make it hold."""
        ways: list[tuple[tuple[int, int, int, int], Need]] = []
        # Short rules first: they lack less, and the budget may end the search.
        rules = sorted(self._program.rules_for(self._equality.rewrite(fact)), key=_size)
        try:
            for rule in rules[:MAX_RULES]:
                ways += self._ways(rule, fact)
        except OutOfBudgetError:
            pass  # what was found is right; there may be nearer ways
        ways.sort(key=lambda way: (way[0], str(way[1])))
        needs = tuple(dict.fromkeys(need for _, need in ways))[:MAX_NEEDS]
        return Refutation(self._terms.decode_fact(fact), self._glossary.fact(fact), needs)

    def _ways(self, rule: Rule, goal: Fact) -> Iterator[tuple[tuple[int, int, int, int], Need]]:
        """Yield what a rule lacks, each with its rank: the least missing first."""
        assert rule.head is not None
        env = rule.environment()
        if not rule.body or not bind(rule.head, goal, self._terms, env):
            return
        # All premises hold and only a condition does not: nothing can be nearer.
        if rule.conditions:
            blocked = self._first(rule.body, list(env))
            if blocked is not None and rule.conclude(blocked) == goal:
                held = self._patterns(rule, rule.body, blocked)
                need = Need(rule.name, (), held, self._condition(rule, blocked))
                yield (0, 0, -len(held), 0), need
                return
        if len(rule.body) > 1:
            ways = [self._all_but(rule, at, env) for at in range(len(rule.body))]
            yield from (way for way in ways if way is not None)
            if any(ways):
                return
        missing = self._patterns(rule, rule.body, env)
        yield (len(missing), _unbound(rule.body, env), 0, 1), Need(rule.name, missing)

    def _all_but(
        self, rule: Rule, at: int, env: Bindings
    ) -> tuple[tuple[int, int, int, int], Need] | None:
        """Return what a rule lacks if all its premises but one hold."""
        rest = (*rule.body[:at], *rule.body[at + 1 :])
        bindings = self._first(rest, list(env))
        if bindings is None:
            return None
        missing = self._patterns(rule, rule.body[at : at + 1], bindings)
        need = Need(rule.name, missing, self._patterns(rule, rest, bindings))
        return (1, _unbound(rule.body[at : at + 1], bindings), -len(rest), 0), need

    def _first(self, atoms: tuple[Atom, ...], env: Bindings) -> Bindings | None:
        """Return the first bindings under which some atoms hold."""
        bound = frozenset(~at for at, value in enumerate(env) if value is not None)
        solution = next(solve(self._view, self._terms, arrange(atoms, (), bound), env), None)
        return None if solution is None else list(solution)

    def _patterns(self, rule: Rule, atoms: tuple[Atom, ...], env: Bindings) -> tuple[str, ...]:
        return tuple(self._glossary.pattern(atom, env, rule.names) for atom in atoms)

    def _condition(self, rule: Rule, env: Bindings) -> str:
        absent = [
            self._glossary.pattern(atom, env, rule.names)
            for group in rule.absences
            for atom in group.atoms
        ]
        others = any(not isinstance(condition, Absent) for condition in rule.conditions)
        words = [f"there may be no {' . '.join(absent)}"] if absent else []
        words += ["a FILTER of the rule is not met"] if others else []
        return " or ".join(words) + ", though its premises hold"


def _size(rule: Rule) -> tuple[int, str]:
    return len(rule.body), rule.name


def _unbound(atoms: tuple[Atom, ...], env: Bindings) -> int:
    return sum(env[~x] is None for atom in atoms for x in atom.variables)
