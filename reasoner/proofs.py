"""Proofs of triples, found backward on demand; nothing is recorded beforehand.

The search deepens by height, so the first proof found is one of the least height and never rests
on itself. It works on triples in their original terms: replacing a term by an equal one is a step
of its own (eq-rep), like in the rules as printed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import islice, product
from typing import Any, ClassVar, TypeAlias

from reasoner.decisions import Budget, OutOfBudgetError, Refutation, Undecided
from reasoner.facts.equality import Equality
from reasoner.facts.layer import Asserted, Layer
from reasoner.facts.relations import Facts
from reasoner.glosses import Glossary, Name, local_name
from reasoner.rules.rule import Bindings, Rule, bind, ground, solve
from reasoner.rules.strata import Program, constants_of
from reasoner.terms.dictionary import Dictionary, Fact, Triple
from reasoner.terms.vocabulary import SAME

Instance = tuple[tuple[Fact, ...], tuple[str, ...]]
"""Premises of a rule's instance, and the patterns that must have no match."""

GraphsOf = Callable[[Triple], Iterable[str]]
MAX_HEIGHT = 64
MAX_VARIANTS = 256


@dataclass(frozen=True)
class Proof:
    """Derivation of a triple.

    Attributes
    ----------
    triple : Triple
        What is proven.
    gloss : str
        The triple in short form, with anonymous classes spelled out.
    rule : str
        Name in OWL 2 Profiles 4.3, `rule:<name>` of a user's rule, or `asserted`.
    premises : tuple of Proof
        Instance triples that the rule used.
    schema : tuple of Triple
        Schema triples from which the rule was compiled; each can be explained in turn.
    absent : tuple of str
        Patterns that had to have no match.
    graphs : tuple of str
        Graphs that assert an asserted triple, if the caller knows them.
    """

    triple: Triple
    gloss: str
    rule: str
    premises: tuple[Proof, ...] = ()
    schema: tuple[Triple, ...] = ()
    absent: tuple[str, ...] = ()
    graphs: tuple[str, ...] = ()

    holds: ClassVar[bool] = True

    def __bool__(self) -> bool:
        return True

    @property
    def is_asserted(self) -> bool:
        """Whether the proof is a leaf."""
        return self.rule == "asserted"

    @property
    def height(self) -> int:
        """Number of rule steps on the longest branch."""
        if self.is_asserted:
            return 0
        return 1 + max((p.height for p in self.premises), default=0)

    def leaves(self) -> Iterator[Triple]:
        """Yield the asserted triples that the proof rests on."""
        if self.is_asserted:
            yield self.triple
        for premise in self.premises:
            yield from premise.leaves()

    def to_dict(self) -> dict[str, Any]:
        """Return the proof as plain data, terms in N-Triples."""
        out: dict[str, Any] = {"triple": [str(x) for x in self.triple], "rule": self.rule}
        if self.is_asserted:
            out["graphs"] = list(self.graphs)
            return out
        out["schema"] = [[str(x) for x in t] for t in self.schema]
        out["premises"] = [p.to_dict() for p in self.premises]
        if self.absent:
            out["absent"] = list(self.absent)
        out["height"] = self.height
        return out

    def __str__(self) -> str:
        return self.render()

    def render(self) -> str:
        """Return the proof as an indented text, one line per triple."""
        return "\n".join(self._lines("", ""))

    def _lines(self, first: str, rest: str) -> Iterator[str]:
        reason = self.rule
        if self.is_asserted and self.graphs:
            reason = "asserted: " + ", ".join(self.graphs)
        yield f"{first + self.gloss:<60} {reason}"
        for pattern in self.absent:
            yield f"{rest}|- absent: {pattern}"
        for premise in self.premises:
            yield from premise._lines(rest + "|- ", rest + "   ")


Decision: TypeAlias = Proof | Refutation | Undecided
"""A statement holds, does not hold, or the budget did not decide it."""


class Expanded:
    """Facts as if no term had been rewritten: each holds for every member of an equality class.

    The rows that rules look at are counted in a budget.
    """

    def __init__(self, facts: Facts | Layer, equality: Equality, budget: Budget) -> None:
        self.work = budget
        self._facts = facts
        self._equality = equality

    def has(self, s: int, p: int, o: int) -> bool:
        """Tell whether a fact in original terms holds."""
        s, p, o = self._equality.rewrite((s, p, o))
        return s == o if p == SAME else self._facts.has(s, p, o)

    def objects(self, p: int, s: int) -> set[int]:
        """Return all objects of a subject, equal ones too."""
        same = self._equality
        if p == SAME:
            return set(same.members(s))
        objects = self._facts.objects(same.find(p), same.find(s))
        return {member for o in tuple(objects) for member in same.members(o)}

    def subjects(self, p: int, o: int) -> set[int]:
        """Return all subjects of an object, equal ones too."""
        same = self._equality
        if p == SAME:
            return set(same.members(o))
        subjects = self._facts.subjects(same.find(p), same.find(o))
        return {member for s in tuple(subjects) for member in same.members(s)}

    def pairs(self, p: int) -> Iterator[tuple[int, int]]:
        """Iterate over all subjects and objects of a property."""
        same = self._equality
        for s, o in self._facts.pairs(same.find(p)):
            yield from product(same.members(s), same.members(o))

    def size(self, p: int) -> int:
        """Return about how many facts a property has."""
        return self._facts.size(self._equality.find(p))


class Prover:
    """Search for proofs in one state of a closure."""

    def __init__(
        self,
        facts: Facts | Layer,
        equality: Equality,
        program: Program,
        asserted: Asserted,
        terms: Dictionary,
        budget: Budget,
        graphs_of: GraphsOf | None = None,
        name: Name = local_name,
    ) -> None:
        self._view = Expanded(facts, equality, budget)
        self._glossary = Glossary(self._view, terms, name)
        self._equality = equality
        self._program = program
        self._asserted = asserted
        self._terms = terms
        self._budget = budget
        self._graphs_of = graphs_of
        self._proven: dict[Fact, Proof] = {}
        self._refuted: dict[Fact, int] = {}

    def prove(self, fact: Fact) -> Proof | Undecided:
        """Return a proof of least height, or that the budget did not suffice to find one."""
        try:
            # Iterative deepening: the first proof found has the least height, and facts that derive
            # each other in a circle never prove themselves.
            for height in range(MAX_HEIGHT):
                proof = self._search(fact, height)
                if proof is not None:
                    return proof
        except OutOfBudgetError:
            pass
        triple, gloss = self._terms.decode_fact(fact), self._glossary.fact(fact)
        return Undecided(triple, gloss, self._budget.spent, self._budget.limit)

    def _search(self, goal: Fact, height: int) -> Proof | None:
        proven = self._proven.get(goal)
        if proven is not None:
            return proven if proven.height <= height else None
        # No proof of this height means none of a smaller one either.
        if self._refuted.get(goal, -1) >= height:
            return None
        self._budget.spend(1)
        proof = self._leaf(goal)
        if proof is None and height > 0:
            proof = next(self._steps(goal, height), None)
        if proof is None:
            self._refuted[goal] = height
        else:
            self._proven[goal] = proof
        return proof

    def _leaf(self, goal: Fact) -> Proof | None:
        if goal in self._asserted:
            triple = self._terms.decode_fact(goal)
            graphs = tuple(self._graphs_of(triple)) if self._graphs_of else ()
            return Proof(triple, self._glossary.fact(goal), "asserted", graphs=graphs)
        if goal[1] == SAME and goal[0] == goal[2]:
            return Proof(self._terms.decode_fact(goal), self._glossary.fact(goal), "eq-ref")
        return None

    def _steps(self, goal: Fact, height: int) -> Iterator[Proof]:
        """Yield the proofs whose last step derives the goal, in a fixed order."""
        # Sets have no order that two runs share; the same question must get the same proof.
        for rule in sorted(self._rules_for(goal), key=self._rule_order):
            for premises, absent in sorted(self._instances(rule, goal), key=self._order):
                yield from self._step(goal, rule.name, premises, height, rule, absent)
        if goal[1] == SAME:
            yield from self._equality_steps(goal, height)
        if any(self._equality.is_merged(x) for x in goal):
            yield from self._replacements(goal, height)

    def _rules_for(self, goal: Fact) -> Iterator[Rule]:
        """Yield the rules that may derive a goal, as the schema was asserted.

        The rules in force mention representatives; a proof must not need an equality that itself
        depends on the axiom in its original terms.
        """
        for rule in self._program.rules_for(self._equality.rewrite(goal)):
            merged = sorted({c for c in constants_of([rule]) if self._equality.is_merged(c)})
            if not merged:
                yield rule
                continue
            # The variants multiply with the members of each class.
            choices = islice(product(*map(self._equality.members, merged)), MAX_VARIANTS)
            variants = [rule.substitute(dict(zip(merged, c, strict=True))) for c in choices]
            stated = [r for r in variants if all(map(self._is_as_asserted, r.because))]
            # What somebody stated in this form can be looked up; the other forms follow from it.
            yield from stated or variants

    def _is_as_asserted(self, fact: Fact) -> bool:
        """Tell whether a schema fact is asserted in this form, or derived in every form."""
        if fact in self._asserted:
            return True
        return not any(form in self._asserted for form in self._equality.forms(fact))

    def _instances(self, rule: Rule, goal: Fact) -> set[Instance]:
        assert rule.head is not None
        env = rule.environment()
        if not bind(rule.head, goal, self._terms, env):
            return set()
        return {
            (tuple(ground(atom, bindings) for atom in rule.body), self._absent(rule, bindings))
            for bindings in solve(self._view, self._terms, rule.backward_steps(goal), env)
            if rule.conclude(bindings) == goal
        }

    def _equality_steps(self, goal: Fact, height: int) -> Iterator[Proof]:
        a, _, b = goal
        yield from self._step(goal, "eq-sym", ((b, SAME, a),), height)
        for middle in self._equality.members(a):
            if middle not in (a, b):
                premises = ((a, SAME, middle), (middle, SAME, b))
                yield from self._step(goal, "eq-trans", premises, height)

    def _replacements(self, goal: Fact, height: int) -> Iterator[Proof]:
        """One term replaced by an equal one (eq-rep-s, eq-rep-p, eq-rep-o)."""
        # Equality has steps of its own, which these would only repeat.
        if goal[1] == SAME:
            return
        for place, name in enumerate(("eq-rep-s", "eq-rep-p", "eq-rep-o")):
            for other in self._equality.members(goal[place]):
                if other == goal[place]:
                    continue
                form = (*goal[:place], other, *goal[place + 1 :])
                premises = ((other, SAME, goal[place]), form)
                yield from self._step(goal, name, premises, height)  # type: ignore[arg-type]

    def _step(
        self,
        goal: Fact,
        name: str,
        premises: tuple[Fact, ...],
        height: int,
        rule: Rule | None = None,
        absent: tuple[str, ...] = (),
    ) -> Iterator[Proof]:
        proofs = []
        for premise in premises:
            proof = self._search(premise, height - 1)
            if proof is None:
                return
            proofs.append(proof)
        decode = self._terms.decode_fact
        because = tuple(map(decode, rule.because)) if rule else ()
        gloss = self._glossary.fact(goal)
        yield Proof(decode(goal), gloss, name, tuple(proofs), because, absent)

    def _absent(self, rule: Rule, env: Bindings) -> tuple[str, ...]:
        return tuple(
            " . ".join(self._glossary.pattern(atom, env, rule.names) for atom in group.atoms)
            for group in rule.absences
        )

    def _rule_order(self, rule: Rule) -> tuple[str, list[tuple[str, ...]]]:
        return rule.name, [self._text(fact) for fact in rule.because]

    def _order(self, instance: Instance) -> list[tuple[str, ...]]:
        return [self._text(fact) for fact in instance[0]]

    def _text(self, fact: Fact) -> tuple[str, ...]:
        return tuple(map(str, self._terms.decode_fact(fact)))
