"""Contradictions, with the assertions that lead to them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from reasoner.fixpoint.checks import LISTED, Inconsistency
from reasoner.proofs import Proof
from reasoner.terms.dictionary import Fact, Triple
from reasoner.terms.vocabulary import LITERAL, SAME

if TYPE_CHECKING:
    from reasoner.reading import Reading

PROOF_BUDGET = 20_000
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


@dataclass(frozen=True, slots=True)
class Contradiction:
    """Statements that cannot all be true.

    Attributes
    ----------
    rule : str
        Name of the check in OWL 2 Profiles 4.3.
    triples : tuple of Triple
        The instance statements that clash.
    axioms : tuple of Triple
        The schema statements that forbid it.
    proofs : tuple of Proof
        Of the triples, as far as they were found within a budget.
    message : str
    equalities : tuple of Proof
        Of the identities by which the triples and the axioms meet, as far as they were found.
    """

    rule: str
    triples: tuple[Triple, ...]
    axioms: tuple[Triple, ...]
    proofs: tuple[Proof, ...]
    message: str
    equalities: tuple[Proof, ...] = ()

    def __str__(self) -> str:
        return self.message

    def culprits(self) -> Iterator[Triple]:
        """Yield each asserted statement behind the clash once; one of them must be wrong."""
        proofs = (*self.proofs, *self.equalities)
        yield from dict.fromkeys(leaf for proof in proofs for leaf in proof.leaves())

    @property
    def is_proven(self) -> bool:
        """Whether a proof of each triple was found."""
        return len(self.proofs) == len(self.triples)


def describe(finding: Inconsistency, reading: Reading) -> Contradiction:
    """Convert a finding to terms, with each premise in an asserted form if there is one."""
    facts = [reading.asserted_form(fact) for fact in finding.premises]
    if finding.rule in LISTED:
        facts = [(facts[0][2], SAME, facts[1][2])]
    decode = reading.terms.decode_fact
    facts.sort(key=lambda fact: str(decode(fact)))
    attempts = [reading.prove(fact, PROOF_BUDGET) for fact in facts]
    proofs = tuple(proof for proof in attempts if isinstance(proof, Proof))
    triples = tuple(map(decode, facts))
    forbidding = [reading.asserted_form(fact) for fact in finding.because]
    axioms = tuple(map(decode, forbidding))
    equalities = tuple(_equalities([*facts, *forbidding], reading))
    premises = "; ".join(" ".join(map(str, triple)) for triple in triples)
    message = f"{MESSAGES.get(finding.rule, 'a clash')} ({finding.rule}): {premises}"
    if finding.rule == "dt-not-type" and axioms:
        message += f", not in {axioms[-1][2]}"
    return Contradiction(finding.rule, triples, axioms, proofs, message, equalities)


def _equalities(facts: list[Fact], reading: Reading) -> Iterator[Proof]:
    """Yield proofs that terms of some facts are the same individual."""
    seen: dict[int, int] = {}
    for number in dict.fromkeys(number for fact in facts for number in fact):
        first = seen.setdefault(reading.equality.find(number), number)
        if first != number and number < LITERAL and first < LITERAL:
            proof = reading.prove((first, SAME, number), PROOF_BUDGET)
            if isinstance(proof, Proof):
                yield proof
