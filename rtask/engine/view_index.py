"""Index of stored views for recognition, derived from the graph and kept in step with it."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from rtask.engine.stored import stored_views
from rtask.engine.upkeep import Upkeep
from rtask.extras import missing_libraries, naming_extras
from rtask.rdf.terms import NamedNode

if TYPE_CHECKING:
    from features.recognition.index.recognition_index import RecognitionIndex
    from features.recognition.recogniser import Recogniser
    from features.recognition.views.view import ViewFeatures
    from rtask.engine.networks.embeddings import Embeddings
    from rtask.kb.core import GraphCore

__all__ = ["ViewIndex"]

log = logging.getLogger(__name__)

Progress = Callable[[int, int], None]

_COMPARED_AT_ONCE = 4
"""Views in a step of the background comparison: some .2 s."""


class ViewIndex:
    """Index of the views of one knowledge base.

    Without the extra ``perception`` there is no index: its use is refused, and everything else
    works. The next start with the extra builds the index from the graph.

    The index is opened when it is first used, or at the start if there are views: the libraries
    that it needs take a quarter of the time in which a server starts.

    Parameters
    ----------
    folder
        Folder of the index; None = in memory.
    writing
        Lock of the writer.
    embeddings
        Vectors of a user's network, brought in step with the views; None = none are used.

    Attributes
    ----------
    generation
        Number of changes of the index; recognition may give another result in the next generation.
    """

    def __init__(
        self,
        kb: GraphCore,
        folder: Path | None,
        writing: threading.RLock,
        embeddings: Embeddings | None = None,
    ) -> None:
        self._kb = kb
        self._folder = folder
        self._writing = writing
        self.embeddings = embeddings
        self.generation = 0
        self._opening = threading.RLock()
        self._opened: tuple[RecognitionIndex, Recogniser] | None = None
        self._may_hold_others = False
        self._keeps_compared = False
        self._upkeep: Upkeep | None = None
        if missing := missing_libraries("perception"):
            log.info("views are not indexed: not installed: %s", ", ".join(missing))

    @property
    def index(self) -> RecognitionIndex:
        """The current index; rebuilding replaces it.

        Raises
        ------
        MissingExtraError
            The extra ``perception`` is not installed.
        """
        return self._require()[0]

    @property
    def recogniser(self) -> Recogniser:
        """Recogniser of the current index; raises like :attr:`index`."""
        return self._require()[1]

    def learn(
        self, view: NamedNode, object_iri: NamedNode, class_iri: str, features: ViewFeatures
    ) -> None:
        """Add a view whose commit has been stored.

        If this fails, the view is not lost: the index is derived data and is completed from the
        graph at the next start.
        """
        try:
            self.index.add(view.value, object_iri.value, class_iri, features)
            self.generation += 1
            if self._upkeep is not None:
                self._upkeep.announce()
        except (OSError, ValueError):
            log.exception("view %s is stored but not indexed yet", view.value)

    def prepare(self, views: Collection[NamedNode]) -> None:
        """Compare new views with the stored ones now, so that the next caller need not wait.

        If this fails, the next query makes the comparison.
        """
        try:
            self.recogniser.prepare([view.value for view in views])
        except (OSError, ValueError):
            log.exception("%d new views will be compared in the next query", len(views))

    def keep_compared(self) -> None:
        """Compare stored views with each other in the background from now on.

        Views that came in bulk, from the graph or from another index, were not compared when they
        were added; without this the first query that meets one does it.
        """
        with self._opening:
            self._keeps_compared = True
            if self._opened is not None and self._upkeep is None:
                self._upkeep = Upkeep("rtask-views", self._compare_some)
                self._upkeep.announce()

    def _compare_some(self) -> int:
        return self.recogniser.compare_outdated(_COMPARED_AT_ONCE)

    def same_print(self, view: NamedNode) -> tuple[str, ...]:
        """Return the IRIs of other objects that carry the print of a view.

        If it cannot be told, there are none: the view is stored all the same.
        """
        try:
            return self.recogniser.same_print(view.value)
        except (OSError, ValueError):
            log.exception("view %s was not compared with other objects' prints", view.value)
            return ()

    def sync(self) -> int:
        """Synchronise the index with the graph; return the number of added views."""
        if self._opened is None and missing_libraries("perception"):
            return 0
        if self.embeddings is not None:
            self.embeddings.sync()
        with self._writing:
            stored = {row.view: row for row in stored_views(self._kb)}
            if not stored and self._opened is None:
                self._may_hold_others = True
                return 0
            present = {name.view_iri: name for name in self.index.views()}
            for view, name in present.items():
                if view not in stored:
                    self.index.remove(view)
                    self.generation += 1
                elif name[1:] != (stored[view].object, stored[view].class_iri):
                    self.index.relabel(view, stored[view].object, stored[view].class_iri)
                    self.generation += 1
            missing = sorted(stored.keys() - present.keys())
            for view in missing:
                row = stored[view]
                features = row.features(self._kb)
                if features is not None:
                    self.learn(NamedNode(view), NamedNode(row.object), row.class_iri, features)
            if missing:
                log.info("indexed %d views from the graph", len(missing))
            return len(missing)

    def rebuild(self, progress: Progress | None = None) -> int:
        """Rebuild the index from the graph alone; return the number of views.

        Parameters
        ----------
        progress
            Called with how many views are read and how many there are; of an index in memory, not.
        """
        from features.recognition.index.recognition_index import RecognitionIndex

        with self._writing:
            self.recogniser.forget_comparisons()
            self.index.close()
            if self._folder is None:
                self._use(RecognitionIndex())
                return self.sync()
            self._use(self._rebuilt(self._folder, progress))
            return len(self.index)

    def close(self) -> None:
        """Close the files."""
        if self._upkeep is not None:
            self._upkeep.close()
        with self._opening:
            if self._opened is not None:
                self._opened[0].close()

    def _use(self, index: RecognitionIndex) -> None:
        from features.recognition.recogniser import Recogniser

        self._opened = (index, Recogniser(index))
        self.generation += 1
        if self._upkeep is not None:
            self._upkeep.announce()

    def _require(self) -> tuple[RecognitionIndex, Recogniser]:
        opened = self._opened
        if opened is None:
            with self._opening, naming_extras("recognition"):
                if self._opened is None:
                    index = self._open()
                    if self._may_hold_others:  # of views that the graph had no more at the start
                        for name in list(index.views()):
                            index.remove(name.view_iri)
                    self._use(index)
                opened = self._opened
            if self._keeps_compared:
                self.keep_compared()
        assert opened is not None
        return opened

    def _open(self) -> RecognitionIndex:
        from features.recognition.index.recognition_index import RecognitionIndex
        from features.recognition.index.segments import IndexCorruptError

        try:
            return RecognitionIndex(self._folder)
        except IndexCorruptError as error:
            if self._folder is None:
                raise
            log.warning("%s; rebuilding the index from the graph", error)
            return self._rebuilt(self._folder)

    def _rebuilt(self, folder: Path, progress: Progress | None = None) -> RecognitionIndex:
        """Rebuild the index of a folder; the old one stays if this is interrupted."""
        from features.recognition.index.recognition_index import RecognitionIndex

        def described() -> Iterator[tuple[str, str, str, bytes]]:
            rows = stored_views(self._kb)
            for number, row in enumerate(rows, 1):
                features = row.features(self._kb)
                if features is not None:
                    yield row.view, row.object, row.class_iri, features.to_bytes()
                if progress is not None:
                    progress(number, len(rows))

        return RecognitionIndex.rebuild(folder, described())
