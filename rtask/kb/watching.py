"""The watching side of a knowledge base: who is told of commits, what happened before."""

from __future__ import annotations

from collections.abc import Callable

from rtask.kb.commit import Change
from rtask.kb.history import HistoryEntry, history, matcher
from rtask.kb.parts import Parts
from rtask.kb.terms import NamedNode, Subject, Value, iri, object_term, stored, subject_term

__all__ = ["Watching"]


class Watching(Parts):
    """Commits as they come, and as they were."""

    def on_commit(self, listener: Callable[[Change], None]) -> Callable[[], None]:
        """Call ``listener`` with each commit, in order, after it is stored and durable.

        Returns
        -------
        A function that ends it.
        """
        return self._writer.listen(listener)

    def history(
        self,
        subject: Subject | str | None = None,
        predicate: NamedNode | str | None = None,
        value: Value | None = None,
        graph: NamedNode | str | None = None,
        agent: str | None = None,
        since: int = 0,
    ) -> list[HistoryEntry]:
        """Return the commits that touched matching statements, oldest first.

        Without a graph, derived statements and the commits' own records are left out.
        """
        matches = matcher(
            None if subject is None else subject_term(subject),
            None if predicate is None else iri(predicate),
            None if value is None else stored(object_term(value)),
            None if graph is None else iri(graph),
            {self.graphs.inferred, self.graphs.meta, self.graphs.provenance},
        )
        return list(history(self._files.journal, matches, agent, since))
