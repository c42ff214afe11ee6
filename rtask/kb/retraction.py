"""Methods for single statements: read annotations and retract."""

from __future__ import annotations

import datetime as dt

from pyoxigraph import Quad

from rtask.errors import UsageError
from rtask.kb.commit.access import Access
from rtask.kb.commit.commit import Commit
from rtask.kb.commit.statements import (
    INVALIDATED,
    Annotation,
    held_by,
    read_annotations,
    reifiers,
    stamp,
)
from rtask.kb.writing import Writing
from rtask.rdf.terms import (
    NamedNode,
    Subject,
    Term,
    TripleKey,
    Value,
    iri,
    object_term,
    stored,
    subject_term,
)

__all__ = ["Retraction"]


class Retraction(Writing):
    """Annotations of statements, and retraction with a reason."""

    def annotations(
        self, subject: Subject | str, predicate: NamedNode | str, value: Value
    ) -> list[Annotation]:
        """Return the annotations of a statement in each graph: confidence, validity, source."""
        return read_annotations(self.store, _key(subject, predicate, value))

    def retract(
        self,
        subject: Subject | str,
        predicate: NamedNode | str,
        value: Value,
        *,
        reason: str | None = None,
        agent: str | None = None,
        graph: NamedNode | str | None = None,
        access: Access | None = None,
    ) -> Commit:
        """Withdraw a statement from all graphs that hold it and that the caller may write.

        Its annotations are kept and marked as invalidated; the reason is recorded with the commit,
        see :meth:`history`.

        Parameters
        ----------
        reason
            Required for a statement in another agent's graph.
        graph
            Withdraw it from this graph only.

        Raises
        ------
        DataError
            No graph holds the statement.
        ForbiddenError
            Only graphs that the caller may not write hold it. State the opposite view in a
            statement of the caller's own instead.
        """
        key = _key(subject, predicate, value)
        rights = self.access(agent, access)
        holders = held_by(self.store, key) if graph is None else [iri(graph)]
        allowed = [g for g in holders if rights.may_write(g)]
        if not allowed:
            rights.require_write(_asserting(self, holders), "retract")
        foreign = [g for g in allowed if g != rights.home()]
        if foreign and not reason:
            raise UsageError(f"retracting a statement of {foreign[0]} requires a reason")
        with self.transaction(agent, reason or "retracted", access=access) as tx:
            for holder in allowed:
                tx.remove(*key, graph=holder)
                for named in reifiers(self.store, key, holder):
                    now = stamp(dt.datetime.now(dt.UTC))
                    tx.add_quads([Quad(named.subject, INVALIDATED, now, holder)])
        return tx.commit


def _asserting(kb: Writing, holders: list[NamedNode]) -> NamedNode:
    """Return the graph to name in an error, preferably one that asserts the statement."""
    return next((g for g in holders if not kb.graphs.is_system(g)), holders[0])


def _key(subject: Subject | str, predicate: NamedNode | str, value: Value) -> TripleKey:
    term: Term = stored(object_term(value))
    return (subject_term(subject), iri(predicate), term)
