"""The engine: one knowledge base, one index of views, and the operations on both."""

from __future__ import annotations

import logging
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rtask.engine.curation.redirects import followed
from rtask.engine.memory.meaning import FunctionCatalogue
from rtask.engine.memory.tasks import Decisions
from rtask.engine.names import Names
from rtask.engine.operations.messages import nearest, read
from rtask.engine.operations.robots import GripperCatalogue
from rtask.engine.operations.table import OPERATIONS, SCOPES, Operation
from rtask.engine.perception.models import Models
from rtask.engine.perception.observation import ObservationCache
from rtask.engine.perception.views import stored_views
from rtask.engine.policy import Policy
from rtask.engine.terms import ClassCatalogue, known_reasons
from rtask.errors import ForbiddenError, UnknownTermError, UnsupportedError
from rtask.kb.commit.access import Access
from rtask.rdf.terms import NamedNode

if TYPE_CHECKING:
    from features.recognition.index.recognition_index import RecognitionIndex
    from features.recognition.views.view import ViewFeatures
    from rtask.kb.commit.commit import Change, Commit
    from rtask.knowledge_base import KnowledgeBase

__all__ = ["Engine"]

log = logging.getLogger(__name__)


class Engine:
    """Answers robots from a knowledge base and writes down what they tell.

    Calls come from many threads. Reading runs in parallel; writing is one call at a time.

    Parameters
    ----------
    kb
        Not a plain one: the engine needs the ontology and the union of graphs.
    index_dir
        Where the index of views is kept; default: ``index`` in the knowledge base's folder, or in
        memory with a knowledge base in memory.
    policy
        Thresholds and weights.

    Attributes
    ----------
    operations
        By name; see :class:`rtask.engine.operations.table.Operation`.

    Examples
    --------
    >>> import rtask
    >>> from rtask.engine import Engine
    >>> with rtask.open(":memory:", reason=False) as kb, Engine(kb) as engine:
    ...     sorted(engine.operations)[:2]
    ['curate_object', 'give_feedback']
    """

    operations: Mapping[str, Operation] = OPERATIONS

    def __init__(
        self,
        kb: KnowledgeBase,
        index_dir: Path | str | None = None,
        policy: Policy | None = None,
    ) -> None:
        if kb.plain:
            raise UnsupportedError("a plain knowledge base has no ontology for the engine")
        self.kb = kb
        self.policy = policy or Policy()
        self.writing = threading.RLock()
        self.names = Names(kb)
        self.grippers = GripperCatalogue(kb)
        self.classes = ClassCatalogue(kb)
        self.functions = FunctionCatalogue(kb)
        self.observations = ObservationCache()
        self.decisions = Decisions()
        self.models = Models(kb)
        self.reasons = known_reasons(kb)
        folder = kb.folder / "index" if index_dir is None and kb.folder else index_dir
        self._index_folder = None if folder is None else Path(folder)
        self._use_index(self._opened_index())
        self._stop_listening = kb.on_commit(self._heard)
        self.sync_index()

    def call(
        self, name: str, args: Mapping[str, Any] | None = None, access: Access | None = None
    ) -> dict[str, Any]:
        """Carry out one operation.

        Parameters
        ----------
        name
            With or without ``/rtask/`` in front.
        args
            The request; unknown fields are refused.
        access
            Of the caller; None = the program that opened the knowledge base.

        Returns
        -------
        JSON-able.

        Raises
        ------
        UnknownTermError
            No such operation, gripper, object ...
        UsageError
            The request does not fit the operation.
        ForbiddenError
            The caller has no right to it.
        """
        operation = self.operations.get(name.removeprefix("/").removeprefix("rtask/"))
        if operation is None:
            raise UnknownTermError(f"no operation {name!r}{nearest(name, list(self.operations))}")
        access = access or Access()
        self.require(access, operation.scope)
        request = read(operation.fields, operation.prepare(dict(args or {})))
        request = followed(self.kb, request)
        return operation.handler(self, request, access)

    def require(self, access: Access, scope: str) -> None:
        """Refuse a caller whose role lacks a scope.

        Raises
        ------
        ForbiddenError
            Naming the scope.
        """
        if scope not in SCOPES[access.role]:
            raise ForbiddenError(f"needs scope {scope}; the role {access.role} lacks it")

    def author(
        self, access: Access, fallback: str | None, role: Literal["robot", "teacher"] = "robot"
    ) -> Access:
        """Return under whose name something is written.

        Callers without a name of their own (a server without tokens, the owner of the store)
        write for the robot or person that the message names, with no more rights than that one.
        """
        if access.agent or not fallback:
            return access
        return Access(fallback, role)

    def agent_iri(self, author: Access) -> NamedNode:
        """Return the individual that stands for an author."""
        if author.agent is None:
            return self.names.named("agent", "anonymous")
        role = "teacher" if author.role == "teacher" else "robot"
        return self.kb.graphs.agent_iri(author.agent, role)

    def commit_id(self, commit: Commit) -> str:
        """Return a commit as messages name it."""
        return f"c-{commit.seq:05d}"

    # The index

    def learn(
        self, view: NamedNode, thing: NamedNode, class_iri: str, features: ViewFeatures
    ) -> None:
        """Let recognition find a view from now on; its commit has been stored already.

        When this fails the view is not lost: the index is derived data, and is completed from the
        graph at the next start.
        """
        try:
            self.index.add(view.value, thing.value, class_iri, features)
        except (OSError, ValueError):
            log.exception("view %s is stored but not indexed yet", view.value)

    def sync_index(self) -> int:
        """Bring the index in step with the graph; return how many views were added."""
        with self.writing:
            wanted = {row.view: row for row in stored_views(self.kb)}
            present = {name.view_iri: name for name in self.index.views()}
            for view, name in present.items():
                if view not in wanted:
                    self.index.remove(view)
                elif name[1:] != (wanted[view].object, wanted[view].class_iri):
                    self.index.relabel(view, wanted[view].object, wanted[view].class_iri)
            missing = sorted(wanted.keys() - present.keys())
            for view in missing:
                row = wanted[view]
                features = row.features(self.kb)
                if features is not None:
                    self.learn(NamedNode(view), NamedNode(row.object), row.class_iri, features)
            if missing:
                log.info("indexed %d views from the graph", len(missing))
            return len(missing)

    def rebuild_index(self) -> int:
        """Make the index again from the graph alone; return the number of views."""
        from features.recognition.index.recognition_index import RecognitionIndex

        with self.writing:
            self.index.close()
            if self._index_folder is None:
                self._use_index(RecognitionIndex())
                return self.sync_index()
            self._use_index(self._made_again())
            return len(self.index)

    def _use_index(self, index: RecognitionIndex) -> None:
        from features.recognition.recogniser import Recogniser

        self.index = index
        self.recogniser = Recogniser(index)

    def _opened_index(self) -> RecognitionIndex:
        from features.recognition.index.recognition_index import RecognitionIndex
        from features.recognition.index.segments import IndexCorruptError

        try:
            return RecognitionIndex(self._index_folder)
        except IndexCorruptError as error:
            log.warning("%s; making the index again from the graph", error)
            return self._made_again()

    def _made_again(self) -> RecognitionIndex:
        """Return the index of the folder, made from the graph; killed halfway, the old stays."""
        from features.recognition.index.recognition_index import RecognitionIndex

        assert self._index_folder is not None
        described = (
            (row.view, row.object, row.class_iri, features.to_bytes())
            for row in stored_views(self.kb)
            if (features := row.features(self.kb)) is not None
        )
        return RecognitionIndex.rebuild(self._index_folder, described)

    def rebuild_statistics(self) -> Commit:
        """Count all grasps again from their attempts."""
        from rtask.engine.memory.statistics import rebuild

        return rebuild(self)

    def rebuild_models(self) -> int:
        """Make the models of all objects again from their views; return their number."""
        from rtask.engine.perception.models import rebuild_models

        return rebuild_models(self)[1]

    def _heard(self, change: Change) -> None:
        self.grippers.forget_if_changed(change)
        self.classes.forget_if_changed(change)
        self.functions.forget_if_changed(change)

    # Life

    def close(self) -> None:
        """Let the index go; the knowledge base stays open."""
        self._stop_listening()
        self.index.close()

    def __enter__(self) -> Engine:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
