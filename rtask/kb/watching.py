"""Methods that follow commits: listeners, subscriptions and history."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable

from rtask.kb.base import GraphBase
from rtask.kb.commit.commit import Change
from rtask.kb.durability.journal import JournalFile
from rtask.kb.feed.as_of import commit_at, replayed_for
from rtask.kb.feed.history import HistoryEntry, Period, history, matcher
from rtask.kb.feed.subscriptions import QUEUE, Filter, Subscription
from rtask.rdf.terms import (
    NamedNode,
    Subject,
    Value,
    iri,
    moment,
    object_term,
    stored,
    subject_term,
)

__all__ = ["Watching"]


class Watching(GraphBase):
    """Notification of commits, and their history."""

    def on_commit(self, listener: Callable[[Change], None]) -> Callable[[], None]:
        """Call ``listener`` with each commit, in order, after it is stored and durable.

        Returns
        -------
        A function that removes the listener.
        """
        return self._writer.listen(listener)

    def subscribe(
        self,
        subject: Subject | str | None = None,
        predicate: NamedNode | str | None = None,
        value: Value | None = None,
        graph: NamedNode | str | None = None,
        *,
        cls: NamedNode | str | None = None,
        inferred: bool = True,
        once: bool = False,
        since: int | str | None = None,
        size: int = QUEUE,
        on_ready: Callable[[], None] | None = None,
    ) -> Subscription[Change]:
        """Subscribe to the commits that touch matching statements, in order, once they are stored.

        Parameters
        ----------
        subject, predicate, value, graph
            Pattern of the statements; ``None`` matches everything.
        cls
            Class whose instances to follow, derived instances included.
        inferred
            Whether to include derived statements.
        once
            Whether to end after the first change.
        since
            Commit to begin after: its number, or ``epoch:number`` as in
            :meth:`Feed.position <rtask.kb.feed.feed.Feed.position>`; the last one if not given.
        size
            Maximum number of unread changes.
        on_ready
            Called from the writer's thread when a change arrives; see :class:`Subscription`.

        Raises
        ------
        GoneError
            The commits after ``since`` are no longer kept.
        EpochChangedError
            ``since`` refers to a numbering from before a backup was restored.
        """
        filter_ = Filter(
            None if subject is None else subject_term(subject),
            None if predicate is None else iri(predicate),
            None if value is None else stored(object_term(value)),
            None if graph is None else iri(graph),
            None if cls is None else iri(cls),
            inferred,
        )
        return self.feed.subscribe(filter_, since=since, once=once, size=size, on_ready=on_ready)

    def commit_at(self, time: dt.datetime | str) -> int:
        """Return the number of the last commit whose clock showed no later time than this.

        Raises
        ------
        GoneError, UnsupportedError
            As in :func:`rtask.kb.feed.as_of.commit_at`.
        """
        return commit_at(self._files, moment(time))

    def changed_since(self, seq: int) -> int:
        """Return how many statements the commits after one have added or removed.

        Bulk loads are not among them, because the journal does not hold what they add.
        """
        journal = self._files.journal
        if not isinstance(journal, JournalFile):
            return 0
        return sum(mark.changed for mark in journal.marks.after(seq))

    def replayed_for(self, seq: int) -> int:
        """Return how many statements are replayed for the state after a commit.

        From the nearest state that is kept, or from the current one.
        """
        return replayed_for(self._files, seq)

    def history(
        self,
        subject: Subject | str | None = None,
        predicate: NamedNode | str | None = None,
        value: Value | None = None,
        graph: NamedNode | str | None = None,
        agent: str | None = None,
        since: int = 0,
        *,
        upto: int | None = None,
        start: dt.datetime | str | None = None,
        end: dt.datetime | str | None = None,
    ) -> list[HistoryEntry]:
        """Return the commits that touched matching statements, oldest first.

        Without a graph, derived statements and the commits' own records are left out.

        Parameters
        ----------
        agent
            Only commits by this robot or person.
        since, upto
            Only commits numbered above ``since`` and up to ``upto``.
        start, end
            Only commits at ``start`` or later and before ``end``.
        """
        matches = matcher(
            None if subject is None else subject_term(subject),
            None if predicate is None else iri(predicate),
            None if value is None else stored(object_term(value)),
            None if graph is None else iri(graph),
            {self.graphs.inferred, self.graphs.meta, self.graphs.provenance},
        )
        period = Period(
            since,
            upto,
            None if start is None else moment(start),
            None if end is None else moment(end),
            agent,
        )
        self._look()
        return list(history(self.feed, self._files.journal, matches, period))
