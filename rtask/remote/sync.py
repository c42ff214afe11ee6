"""Commits of other processes on the same server: noticed, taken in, announced."""

from __future__ import annotations

import logging
import threading
from collections.abc import Sequence

from rtask.errors import ClosedError, RtaskError
from rtask.kb.commit.writer import Writer
from rtask.kb.durability.journal import Record
from rtask.kb.feed.feed import Feed
from rtask.kb.feed.outage import Outage
from rtask.rdf.terms import LONG_AGO, TripleKey, triple_key
from rtask.remote.journal import RemoteJournal
from rtask.remote.store import RemoteStore

__all__ = ["Sync"]

_log = logging.getLogger(__name__)
EVERY_S = 1.0


class Sync:
    """Keeps what one process knows of a server current.

    It looks for commits of others once a second, and before each change of its own.

    Parameters
    ----------
    writer, feed
        Of the knowledge base.
    """

    def __init__(
        self, store: RemoteStore, journal: RemoteJournal, writer: Writer, feed: Feed
    ) -> None:
        self._store = store
        self._journal = journal
        self._writer = writer
        self._feed = feed
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name="rtask-remote", daemon=True)
        store.on_moved = self.take_in
        store.on_close = self.close

    def start(self) -> None:
        """Start looking for commits of others."""
        self._thread.start()

    def take_in(self) -> None:
        """Renew what this process knows; called with the writer's lock."""
        committer, store = self._writer.committer, self._store
        before, latest = committer.last_seq, store.head
        store.forget()
        store.head = store.read_head()
        try:
            committer.catalogue.refresh()
            last_time = committer.catalogue.last_time() or LONG_AGO
            records = list(self._journal.records(before))
            if committer.inference is not None:
                committer.inference.take_in(self._changed(records, before))
        except BaseException:
            store.head = latest  # so that the next look takes in the same commits
            raise
        committer.last_seq = store.head.seq
        committer.last_time = last_time
        self._writer.take_in([self._feed.read(record) for record in records])
        _log.debug("took in commits %d to %d of another process", before + 1, store.head.seq)

    def _changed(self, records: Sequence[Record], before: int) -> list[TripleKey] | None:
        """Return the triples for the reasoner that commits changed; ``None`` if not known."""
        numbers = [record.seq for record in records]
        if not numbers or numbers != list(range(before + 1, self._store.head.seq + 1)):
            return None
        graphs = self._writer.committer.graphs
        changed: dict[TripleKey, None] = {}
        for record in records:
            if record.header.get("kind") != "delta" or record.header.get("partial"):
                return None
            for quad in (*record.removed(), *record.added()):
                if quad.graph_name == graphs.rules:
                    return None
                if graphs.is_input(quad.graph_name):
                    changed[triple_key(quad)] = None
        return list(changed)

    def _save_if_due(self) -> None:
        """Save the closure, so that the next opening need not derive everything again."""
        inference = self._writer.committer.inference
        if inference is None or not inference.is_save_due():
            return
        with self._writer.exclusive():
            save = inference.prepare_save()
        if save is not None:
            save()

    def _run(self) -> None:
        outage = Outage(_log, "commits of others cannot be seen")
        while not self._closed.wait(EVERY_S):
            try:
                self.look()
                self._save_if_due()
                outage.ended()
            except ClosedError:
                return
            except RtaskError as error:
                outage.failed(error)

    def look(self) -> None:
        """Apply the commits of others, if there are any."""
        head = self._store.head
        if self._store.read_head() == head:
            return
        with self._writer.exclusive():
            if self._store.read_head() != self._store.head:
                self.take_in()
        self._writer.announce()

    def close(self) -> None:
        """Stop looking."""
        self._closed.set()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(timeout=10.0)
