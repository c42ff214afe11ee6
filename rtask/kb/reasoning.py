"""Methods of the reasoner: rules, proofs, contradictions, quarantine and rebuilding."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

import ontology
from rtask.errors import UnsupportedError, UsageError
from rtask.kb.commit.access import Access
from rtask.kb.commit.bulk import complete, finish_bulk, take_in
from rtask.kb.commit.commit import Commit, Request
from rtask.kb.commit.entailment import Entailment, as_triples
from rtask.kb.commit.inference import Inference
from rtask.kb.commit.quarantine import Quarantined, reinstate, statements
from rtask.kb.rules import rulebook
from rtask.kb.rules.rule import Rule, Source, read_rules
from rtask.kb.rules.rulebook import stored_rules
from rtask.kb.store.overlay import Overlay
from rtask.kb.writing import Writing
from rtask.rdf.terms import (
    NamedNode,
    Subject,
    Term,
    Value,
    iri,
    object_term,
    stored,
    subject_term,
)

if TYPE_CHECKING:
    from reasoner.proofs import Decision

__all__ = ["ENTAILMENT_BUDGET", "PROOF_BUDGET", "Reasoning"]

PROOF_BUDGET = 50_000
"""Steps of one proof, unless the question says otherwise: about a second; most take a hundred."""
ENTAILMENT_BUDGET = 2_000_000
"""Steps of one question whether statements follow, unless it says otherwise."""


class Reasoning(Writing):
    """Inference from the asserted graphs."""

    def contradictions(self) -> list[Any]:
        """Return the contradictions in the asserted graphs."""
        with self._writer.exclusive():
            return self._reasoner().contradictions()

    def causes(self, budget_ms: float = 5_000) -> list[dict[str, Any]]:
        """Return the smallest sets of asserted statements that lead to contradictions.

        Parameters
        ----------
        budget_ms
            How long to look for them.

        Returns
        -------
        list of dict
            ``statements`` to choose from, those ``known`` with them, ``rules``, an ``example``.
        """
        with self._writer.exclusive():
            return self._reasoner().causes(budget_ms)

    def explain(
        self,
        subject: Subject | str,
        predicate: NamedNode | str,
        value: Value,
        *,
        budget: int = PROOF_BUDGET,
    ) -> Decision:
        """Return whether a statement holds, with its proof or with what it lacks.

        Parameters
        ----------
        subject, predicate
            Terms, or full IRIs.
        value
            A term, a number, a truth value or a time; a text could be either an IRI or a literal.
        budget
            Steps of the reasoner: goals, and rows that rules look at.

        Returns
        -------
        :class:`reasoner.Proof`, whose leaves name the graphs that assert them;
        :class:`reasoner.Refutation`, with what would make the statement hold; or
        :class:`reasoner.Undecided`, where the budget did not suffice. ``holds`` is True, False or
        None.

        Raises
        ------
        UsageError
            A text stands where a term is needed.
        """
        triple = (_subject(subject), _predicate(predicate), _value(value))
        # The closure changes in place with each commit; half of one would be no proof of anything.
        with self._writer.exclusive():
            return self._reasoner().explain(triple, budget)

    def rules(self) -> list[Rule]:
        """Return the rules of the user, sorted by label."""
        return stored_rules(self.store.quads_for_pattern(None, None, None, self.graphs.rules))

    def add_rules(
        self,
        rules: Source | Iterable[Source],
        agent: str | None = None,
        *,
        access: Access | None = None,
        replace: bool = False,
        note: str | None = "add rules",
    ) -> Commit:
        """Add rules of the user, as one commit with what follows from them.

        Parameters
        ----------
        rules
            Rules, files or folders of rules, or text; see :func:`rtask.kb.rules.rule.read_rules`.
        agent, access
            The author: a name, which has a robot's rights, or rights assigned by a server.
        replace
            Replace rules of the same label and another text.

        Raises
        ------
        ParseError
            A rule cannot be used; gives line and column. Nothing is stored.
        ForbiddenError
            The author may not add rules.
        ConflictError
            There is another rule of that label.
        InconsistentError
            What follows contradicts the ontology.
        """
        parsed = read_rules(rules)
        rights = self.access(agent, access)
        author = self.graphs.agent_iri(rights.agent, rights.role) if rights.agent else None
        return self._change_rules(
            lambda change: rulebook.add(change, parsed, self.graphs, author, replace), rights, note
        )

    def remove_rules(
        self,
        names: str | Iterable[str],
        agent: str | None = None,
        *,
        access: Access | None = None,
        note: str | None = "remove rules",
    ) -> Commit:
        """Remove rules, named by label or IRI, with what followed from them alone.

        Raises
        ------
        UnknownTermError
            There is no such rule.
        ForbiddenError
            The author may not remove rules.
        """
        labels = [names] if isinstance(names, str) else list(names)
        rights = self.access(agent, access)
        return self._change_rules(
            lambda change: rulebook.remove(change, labels, self.graphs), rights, note
        )

    def _change_rules(
        self, edit: Callable[[Overlay], None], rights: Access, note: str | None
    ) -> Commit:
        if self.plain:
            raise UnsupportedError("a plain SPARQL dataset has no rules")
        rights.require_write(self.graphs.rules, "rules")
        overlay = self._writer.begin()
        try:
            edit(overlay)
        except BaseException:
            self._writer.cancel()
            raise
        return self._writer.finish(overlay, Request(rights, note=note))

    def entails(
        self,
        conclusion: Iterable[tuple[Subject, NamedNode, Term]],
        *,
        budget: int = ENTAILMENT_BUDGET,
    ) -> Entailment:
        """Return whether statements follow from the asserted graphs.

        What the closure does not hold is negated, and a contradiction then proves it; the answer
        is ``None`` where no such test decides. Blank nodes stand for something.

        Parameters
        ----------
        conclusion
            Triples of terms; a whole ontology, too.
        budget
            Steps of the reasoner; what is not decided within them stays undecided.

        Returns
        -------
        :class:`rtask.kb.commit.entailment.Entailment`, with proofs of what follows and what is
        missing.

        Raises
        ------
        UsageError
            A statement contains a triple term.
        """
        triples = as_triples(conclusion)
        with self._writer.exclusive():
            reasoner = self._reasoner()
            return Entailment.of(reasoner.entails(triples, budget), reasoner.names(), budget)

    def quarantined(self) -> list[Quarantined]:
        """Return the contradictory statements in quarantine."""
        return statements(self.store, self.graphs)

    def release(
        self, nodes: Iterable[str] | None = None, agent: str | None = None, drop: bool = False
    ) -> Commit:
        """Return statements from the quarantine to their graphs, as one commit.

        Parameters
        ----------
        nodes
            IRIs of the records, see :meth:`quarantined`; all records if not given.
        agent
            The author, who must have the right to write these graphs.
        drop
            Delete the statements instead.

        Raises
        ------
        InconsistentError
            The statements still contradict the rest; nothing changes.
        """
        access = self.access(agent)
        overlay = self._writer.begin()
        try:
            reinstate(overlay, self.graphs, nodes, drop, access)
        except BaseException:
            self._writer.cancel()
            raise
        note = "forget what is in quarantine" if drop else "release from quarantine"
        request = Request(access, note=note, trusted=True, strict=True)
        return self._writer.finish(overlay, request)

    def _reasoner(self) -> Inference:
        if self._inference is None:
            raise UnsupportedError(
                "this knowledge base was opened without reasoning; open it with reasoning on"
            )
        return self._inference

    @property
    def is_outdated(self) -> bool:
        """Whether other rules, or another version of the reasoner, made the inferred graph.

        It is known from the closure that was saved in the folder; without one, it is taken not to.
        """
        return self._inference is not None and self._inference.is_outdated()

    def rebuild(self, what: str = "inferred") -> Commit:
        """Recompute the inferred graph and commit the difference.

        Raises
        ------
        UsageError
            If ``what`` is neither ``inferred`` nor ``all``.
        """
        if what not in ("inferred", "all"):
            raise UsageError(f"cannot rebuild {what!r}; one of inferred, all")
        # The saved closure goes first: killed from here on, the next opening derives all again
        # instead of trusting what was to be replaced.
        self._reasoner().discard_saved()
        request = Request(self.access(), note="rebuild inferred", trusted=True)
        try:
            return finish_bulk(self._writer, self._inference, request)
        finally:
            self.readers.invalidate()

    def complete_interrupted(self) -> bool:
        """Complete a bulk load that a crash interrupted; return whether there was one."""
        return complete(self._writer, self._files, self._inference, self.access())

    def take_in_lost(self) -> bool:
        """Count statements whose commits were lost when the machine stopped, and derive again."""
        return take_in(self._writer, self._files, self._inference, self.access())


def _subject(subject: Subject | str) -> Subject:
    return subject_term(_full(subject) if isinstance(subject, str) else subject)


def _predicate(predicate: NamedNode | str) -> NamedNode:
    return iri(_full(predicate) if isinstance(predicate, str) else predicate)


def _value(value: Value) -> Term:
    if isinstance(value, str):
        raise UsageError(
            f"is {value!r} an IRI or a text? Give the value as rtask.rdf.terms.iri(...) or "
            "literal(...)"
        )
    return stored(object_term(value))


def _full(text: str) -> str:
    """Return a full IRI; a prefixed name would be taken for an IRI that nothing uses."""
    prefix = text.partition(":")[0]
    if prefix == "kb" or prefix in ontology.PREFIXES:
        raise UsageError(f"{text!r} is a prefixed name; give the full IRI, or a term")
    return text
