"""Whether a statement holds, in the form that commands, pages, JSON and agents share.

Three answers: it holds, with a proof; it does not, with what would be needed; or the budget did
not decide it, with how to ask for more.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from rtask.errors import nearest
from rtask.kb.reasoning import PROOF_BUDGET
from rtask.kb.store.naming import prefixed
from rtask.rdf.terms import TripleKey

if TYPE_CHECKING:
    from reasoner import Decision
    from rtask.kb.core import GraphCore

__all__ = ["WORDS", "Explanation", "explain"]

WORDS = {True: "holds", False: "does not hold", None: "not decided"}


@dataclass(frozen=True)
class Explanation:
    """The decision about a statement, and the state of the graph that it is about.

    Parameters
    ----------
    triple
        The statement.
    decision
        :class:`reasoner.Proof`, :class:`reasoner.Refutation` or :class:`reasoner.Undecided`.
    asserted_in
        Graphs that assert it, in N-Triples syntax.
    commit
        Number of the commit after which this was so.
    """

    triple: TripleKey
    decision: Decision
    asserted_in: tuple[str, ...]
    commit: int

    @property
    def holds(self) -> bool | None:
        """Whether the statement holds; None where that is not decided."""
        return self.decision.holds

    @property
    def verdict(self) -> str:
        """The answer in two or three words."""
        return WORDS[self.holds]

    def to_dict(self) -> dict[str, Any]:
        """Return the answer as JSON-able values, with terms in N-Triples syntax."""
        document: dict[str, Any] = {
            "holds": self.holds,
            "verdict": self.verdict,
            "asserted_in": list(self.asserted_in),
            "proof": None,
            "text": self.decision.render() if self.holds else None,
            "commit": self.commit,
        }
        plain = self.decision.to_dict()
        if self.holds:
            return {**document, "proof": plain}
        del plain["triple"]
        return {**document, **plain, "reason": self.decision.render()}


def explain(kb: GraphCore, triple: TripleKey, budget: int = PROOF_BUDGET) -> Explanation:
    """Return whether a statement holds, and why or why not."""
    names = sorted(str(quad.graph_name) for quad in kb.match(*triple))
    asserted = tuple(name for name in names if name != str(kb.graphs.inferred))
    decision = _with_hints(kb, kb.explain(*triple, budget=budget))
    return Explanation(triple, decision, asserted, kb.seq)


def _with_hints(kb: GraphCore, decision: Decision) -> Decision:
    """Name, beside each term that no statement mentions, the declared one that may be meant."""
    from reasoner import Refutation

    if not isinstance(decision, Refutation) or not decision.unknown:
        return decision
    declared = sorted(prefixed(term) for term in kb.catalogue.declared())

    def hint(term: str) -> str:
        prefix, colon, _ = term.partition(":")  # what is spelt out as an IRI is no slip of the pen
        beside = [name for name in declared if name.startswith(prefix + colon)]
        return "" if term.startswith("<") else nearest(term, beside)

    hinted = tuple(term + hint(term) for term in decision.unknown)
    return replace(decision, unknown=hinted)
