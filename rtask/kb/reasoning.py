"""Methods of the reasoner: proofs, contradictions, quarantine and rebuilding."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rtask.errors import UnsupportedError, UsageError
from rtask.kb.commit.bulk import complete, finish_bulk
from rtask.kb.commit.commit import Commit, Request
from rtask.kb.commit.inference import Inference
from rtask.kb.commit.quarantine import Quarantined, reinstate, statements
from rtask.kb.writing import Writing
from rtask.rdf.terms import NamedNode, Subject, Value, iri, object_term, stored, subject_term

__all__ = ["Reasoning"]


class Reasoning(Writing):
    """Inference from the asserted graphs."""

    def contradictions(self) -> list[Any]:
        """Return the contradictions in the asserted graphs."""
        with self._writer.exclusive():
            found: list[Any] = self._reasoner().closure().contradictions()
        return found

    def explain(
        self, subject: Subject | str, predicate: NamedNode | str, value: Value
    ) -> Any | None:
        """Return the proof of a statement, or ``None`` if it does not hold.

        See :class:`reasoner.proofs.Proof`; the leaves name the graphs that assert them.
        """
        triple = (subject_term(subject), iri(predicate), stored(object_term(value)))
        with self._writer.exclusive():
            return self._reasoner().explain(triple)

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

    def rebuild(self, what: str = "inferred") -> Commit:
        """Recompute the inferred graph and commit the difference.

        Raises
        ------
        UsageError
            If ``what`` is neither ``inferred`` nor ``all``.
        """
        if what not in ("inferred", "all"):
            raise UsageError(f"cannot rebuild {what!r}; one of inferred, all")
        self._reasoner()
        request = Request(self.access(), note="rebuild inferred", trusted=True)
        try:
            return finish_bulk(self._writer, self._inference, request)
        finally:
            self.readers.invalidate()

    def complete_interrupted(self) -> bool:
        """Complete a bulk load that a crash interrupted; return whether there was one."""
        return complete(self._writer, self._files, self._inference, self.access())
