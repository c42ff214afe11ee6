"""The embedded knowledge base: one store, its named graphs, its blobs, its reasoner."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Iterable
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, BinaryIO

from pyoxigraph import RdfFormat

from rtask.kb.commit.reasoning import Reasoning
from rtask.kb.commit.retraction import Stating
from rtask.kb.feed.live_queries import RowChange, require_select
from rtask.kb.feed.subscriptions import Subscription
from rtask.kb.feed.watching import Watching
from rtask.kb.readers.reading import Reading
from rtask.objects import Objects
from rtask.rdf.terms import NamedNode

if TYPE_CHECKING:
    from rtask.kb.checks.validation import Violation
    from rtask.kb.checks.verify import Finding

__all__ = ["KnowledgeBase"]


class KnowledgeBase(Reading, Watching, Reasoning, Stating, Objects):
    """A graph that robots share; made by :func:`rtask.open`.

    Reading is possible from any thread, writing is one commit at a time. Use it as a context
    manager, or call :meth:`close`.

    Attributes
    ----------
    graphs
        Names of the graphs.
    blobs
        Byte strings that the graph names.
    folder
        Where it lives; ``None`` in memory.
    store
        The quads; for reading only.
    """

    def warm_up(self) -> None:
        """Build the closure and start the readers now instead of at the first use.

        The replica of a large folder is finished in the background.
        """
        if self._inference is not None:
            with self._writer.exclusive():
                self._inference.closure()
        if self.readers.possible:
            self.readers.start(wait=False)

    def subscribe_query(
        self,
        text: str,
        *,
        timeout_s: float = 5.0,
        on_ready: Callable[[], None] | None = None,
        **options: Any,
    ) -> Subscription[RowChange]:
        """Follow the rows of a SELECT: those of now, then what comes and goes.

        It is asked again after commits that touch a predicate it names, once for several commits
        in quick succession.

        Parameters
        ----------
        timeout_s
            For each evaluation.
        options
            As in :meth:`query`.

        Raises
        ------
        TooLargeError
            More than 1,000 rows; also later, from the subscription.
        """
        require_select(text)
        options["timeout_s"] = timeout_s
        return self.standing.add(text, partial(self.select, text, **options), on_ready)

    def stats(self) -> dict[str, Any]:
        """Return counts: distinct triples, asserted and inferred statements, graphs, commits."""
        from rtask.kb.store.statistics import collect

        return collect(self)

    def dump(
        self,
        path: Path | str | BinaryIO,
        format: RdfFormat | str | None = None,
        graphs: Iterable[NamedNode | str] | None = None,
        inferred: bool = False,
    ) -> int:
        """Write graphs to a file; see :func:`rtask.loader.export.dump`."""
        from rtask.loader.export import dump

        return dump(self, path, format, graphs, inferred)

    def validate(self) -> list[Violation]:
        """Hold everything against the SHACL shapes; see :mod:`rtask.kb.checks.validation`."""
        from rtask.kb.checks.validation import everything

        return everything(self.store, self.graphs)

    def as_of(self, seq: int) -> KnowledgeBase:
        """Return what was known after a commit, as a copy in memory for reading only.

        Close it when it is no longer needed. See :func:`rtask.kb.feed.as_of.as_of`.
        """
        from rtask.kb.feed.as_of import as_of

        return as_of(self, self._files, seq)

    def verify(self, repair: bool = False, parts: Collection[str] | None = None) -> list[Finding]:
        """Compare derived data with their sources; see :mod:`rtask.kb.checks.verify`."""
        from rtask.kb.checks.verify import PARTS, verify

        return verify(self, self._writer, self._inference, repair, parts or PARTS)

    def collect_blobs(self, older_than_s: float = 86_400.0) -> int:
        """Delete the blobs that no statement names; return how many."""
        from rtask.kb.checks.verify import collect_blobs

        return collect_blobs(self, self._writer, older_than_s)

    def backup(self, target: Path | str) -> dict[str, Any]:
        """Copy to a new folder; see :func:`rtask.kb.durability.backup.backup`."""
        from rtask.kb.durability.backup import backup

        return backup(self._files, self._writer, Path(target))

    def publish(self, **facts: Any) -> None:
        """Tell others who find the folder locked more, e.g. the ``url`` that serves it."""
        if self._files.lock is not None:
            self._files.lock.publish(**facts)

    def checkpoint(self) -> None:
        """Make the store durable by itself, so that opening need not replay the journal."""
        if self._files.checkpoints is not None:
            with self._writer.exclusive():
                self._files.checkpoints.make(self.seq)

    def close(self) -> None:
        """Finish the running write, make everything durable and let the folder go."""
        if not self.store.is_open:
            return
        self.expiry.close()
        self._writer.close()
        self.feed.close()
        self.readers.close()
        self.standing.close()
        self.index.close()
        if self._writer.committer.interrupted:
            self._files.abandon()
        else:
            self._files.close(self.seq)

    def __enter__(self) -> KnowledgeBase:
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
        return f"<KnowledgeBase {where} base {self.base}>"
