"""The embedded graph: all parts of this folder combined into one class."""

from __future__ import annotations

import datetime as dt
import logging
import warnings
from collections.abc import Callable, Collection, Iterable, Sequence
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, NoReturn, Self

from rtask.errors import RemoteError, RtaskError, UnsupportedError, UsageError
from rtask.kb.branches.branching import Branching
from rtask.kb.commit import validation
from rtask.kb.commit.validation import ValidationReport
from rtask.kb.durability.journal import JournalFile, Record
from rtask.kb.feed.as_of import copy_as_of
from rtask.kb.feed.live_queries import RowChange, require_select
from rtask.kb.feed.subscriptions import Subscription
from rtask.kb.maintenance import statistics
from rtask.kb.maintenance import verify as verification
from rtask.kb.maintenance.backup import backup
from rtask.kb.maintenance.replica import JournalTail, apply_records
from rtask.kb.maintenance.verify import Finding
from rtask.kb.proposing import Proposing
from rtask.kb.reading import Reading
from rtask.kb.reasoning import Reasoning
from rtask.kb.retraction import Retraction
from rtask.kb.reverting import Reverting
from rtask.kb.watching import Watching

__all__ = ["GraphCore"]

_log = logging.getLogger(__name__)


class GraphCore(Reading, Watching, Reasoning, Retraction, Reverting, Proposing, Branching):
    """A graph in one process: reads, watches, commits, reasons, retracts and checks itself.

    The loader, the object layer and the bridges to other libraries work on this class;
    :class:`rtask.knowledge_base.KnowledgeBase` adds them as methods.
    """

    @property
    def needs_exact_changes(self) -> bool:
        """Whether every statement of a load must pass through a commit, however large the load is.

        So it is in a branch, while shapes are checked, contradictory statements go to quarantine,
        or somebody subscribes; otherwise large documents are streamed into the store.
        """
        committer = self._writer.committer
        if self._files.is_branch:
            return True
        if committer.validator is not None or committer.quarantines:
            return True
        return self.feed.has_subscribers or self.live_queries.has_subscribers

    def warm_up(self) -> None:
        """Build the closure and start the readers now instead of on first use.

        The replica of a large folder is finished in the background.
        """
        if self._inference is not None:
            with self._writer.exclusive():
                self._inference.closure()
        if self.readers.possible:
            self.readers.start(wait=False, updates=True)

    def subscribe_query(
        self,
        text: str,
        *,
        timeout_s: float = 5.0,
        on_ready: Callable[[], None] | None = None,
        **options: Any,
    ) -> Subscription[RowChange]:
        """Follow the rows of a SELECT: the current rows, then each that appears or disappears.

        The query is evaluated again after commits that touch a predicate it names; commits in
        quick succession share one evaluation.

        Parameters
        ----------
        timeout_s
            Time limit of each evaluation.
        options
            As in :meth:`query`.

        Raises
        ------
        TooLargeError
            The answer has more than 1,000 rows; the subscription raises this if it grows later.
        """
        require_select(text)
        options["timeout_s"] = timeout_s
        return self.live_queries.add(text, partial(self.select, text, **options), on_ready)

    def __reduce__(self) -> NoReturn:
        raise UsageError(
            "an open knowledge base is neither pickled nor copied: it holds files and locks; pass "
            f"on where it is ({self.folder or ':memory:'}), and open that in the other process"
        )

    def stats(self) -> dict[str, Any]:
        """Return counts: distinct triples, asserted and inferred statements, graphs, commits."""
        return statistics.collect(self)

    def validate(self, shapes: Path | str | Iterable[Path | str] = ()) -> ValidationReport:
        """Check all data against SHACL shapes.

        Parameters
        ----------
        shapes
            Files of shapes, in addition to those of all graphs and of the ontology.

        Returns
        -------
        ValidationReport
            A list of violations, which says in ``shapes`` what was checked.

        Raises
        ------
        DataError
            Shapes cannot be read, or break the rules of SHACL.
        """
        return validation.everything(self.store, self.graphs, validation.shape_files(shapes))

    def as_of(self, at: int | dt.datetime | str) -> Self:
        """Return the state after a commit or at a time, as a read-only copy.

        Close it when it is no longer needed.

        Parameters
        ----------
        at
            Number of a commit, or a time (of ISO 8601 as a text): the state after the last commit
            whose clock showed no later one.

        Raises
        ------
        UsageError, GoneError, UnsupportedError, StorageFullError
            As in :func:`rtask.kb.feed.as_of.copy_as_of`.
        """
        seq = at if isinstance(at, int) else self.commit_at(at)
        files, catalogue, writer = copy_as_of(self._files, self.graphs, self.feed, self.seq, seq)
        return type(self)(files, catalogue, None, writer)

    def verify(self, repair: bool = False, parts: Collection[str] | None = None) -> list[Finding]:
        """Compare derived data with their sources; see :mod:`rtask.kb.maintenance.verify`."""
        chosen = parts or verification.PARTS
        return verification.verify(self, self._writer, self._inference, repair, chosen)

    def collect_blobs(self, older_than_s: float = 86_400.0) -> int:
        """Delete the blobs that no statement names; return how many."""
        if self._files.is_branch:
            raise UnsupportedError("a branch has the blobs of its trunk; collect them there")
        besides = self.blobs_of_branches()
        return verification.collect_blobs(self, self._writer, older_than_s, besides)

    def backup(self, target: Path | str, *, blobs: bool = True) -> dict[str, Any]:
        """Copy to a new folder; see :func:`rtask.kb.maintenance.backup.backup`."""
        self._writer.require_no_refusal()
        return backup(self._files, self._writer, Path(target), blobs)

    def journal_tail(self, after: int) -> JournalTail:
        """Return a reader of the records of the commits after one, as they are written."""
        return JournalTail(self._files, after)

    def follow(self, url: str) -> None:
        """Take commits from another process only, by :meth:`apply_records`."""
        self.expiry.close()
        self._writer.follows = url

    def apply_records(self, records: Sequence[Record]) -> None:
        """Store commits of the process that this one follows."""
        apply_records(self._writer, self._files, self.feed, records)

    def publish(self, **facts: Any) -> None:
        """Add facts to the lock file for other processes, e.g. the ``url`` serving the folder."""
        if self._files.lock is None:
            return
        try:
            self._files.lock.publish(**facts)
        except OSError as error:  # a full disk; without the facts others only find less
            _log.warning("%s is not told to other processes: %s", ", ".join(facts), error)

    def refuse_writes(self, reason: RtaskError) -> None:
        """Give a reason to those that try to write what is open for reading only."""
        self._writer.refusal = reason

    def checkpoint(self) -> None:
        """Force the store to disk, so that opening need not replay the journal."""
        if self._files.checkpoints is not None:
            with self._writer.exclusive():
                self._files.checkpoints.make(self.seq)

    def close(self) -> None:
        """Finish the current write, force everything to disk and release the folder."""
        if not self.store.is_open:
            return
        self.close_branches()
        self.expiry.close()
        if self._follower is not None:
            self._follower.close()
        self._writer.close()
        self._writer.settle()
        self.feed.close()
        self.readers.close()
        self.live_queries.close()
        self.proposals.close()
        self.index.close()
        if self._writer.committer.interrupted:
            self._files.abandon()
        else:
            self._save_closure()
            self._files.close(self.seq)

    def _save_closure(self) -> None:
        """Save the closure for the next opening."""
        checkpoints, journal = self._files.checkpoints, self._files.journal
        is_read_only = checkpoints is None and isinstance(journal, JournalFile)
        if self._inference is None or is_read_only or self.store.is_stuck:
            return
        journal.sync(self.seq)
        try:
            save = self._inference.prepare_save()
        except RemoteError as error:
            _log.warning("the closure was not saved, the server does not answer: %s", error)
            return
        if save is not None:
            save()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def __del__(self) -> None:
        if self.folder is not None and self.store.is_open:
            warnings.warn(f"unclosed {self!r}", ResourceWarning, stacklevel=2)

    def __repr__(self) -> str:
        where = self.folder or "in memory"
        return f"<{type(self).__name__} {where} base {self.base}>"
