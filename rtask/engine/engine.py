"""The engine: operations on a knowledge base and its index of views."""

from __future__ import annotations

import contextlib
import itertools
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rtask.engine.context import Context
from rtask.engine.memory.statistics import rebuild
from rtask.engine.networks.printed_words import reader_by_environment
from rtask.engine.operations.operation import Operation
from rtask.engine.operations.table import OPERATIONS
from rtask.engine.perception.growth import rebuild_models
from rtask.engine.perception.reading import read_stored_views
from rtask.engine.policy import Policy
from rtask.errors import UnknownTermError, UnsupportedError, nearest
from rtask.extras import naming_extras
from rtask.kb.commit.access import Access
from rtask.wire.message import Answer

if TYPE_CHECKING:
    from features.recognition.index.recognition_index import RecognitionIndex
    from features.words.word import WordReader
    from rtask.engine.grippers import GripperCatalogue
    from rtask.engine.names import Names
    from rtask.engine.stored import Models
    from rtask.engine.terms import ClassCatalogue
    from rtask.engine.view_index import Progress
    from rtask.kb.commit.commit import Commit
    from rtask.kb.core import GraphCore

__all__ = ["Call", "Engine"]


@dataclass(frozen=True)
class Call:
    """One call of an operation, as listeners learn of it: when it begins and when it ends.

    Parameters
    ----------
    number
        The same at both times.
    operation
        Name of the operation.
    access
        Rights of the caller.
    answer, error
        How it ended; both are none when it begins.
    """

    number: int
    operation: str
    access: Access
    answer: Answer | None = None
    error: Exception | None = None


class Engine:
    """Answers robots from a knowledge base and stores what they report.

    Calls come from many threads. Reading runs in parallel; writing is one call at a time.

    Parameters
    ----------
    kb
        Knowledge base with the ontology and the union of graphs; not a plain one.
    index_dir
        Folder of the index of views; default: ``index`` in the knowledge base's folder, or in
        memory with a knowledge base in memory.
    policy
        Thresholds and weights.
    embedder
        ONNX file of a network whose vectors propose objects where print is missing; default: the
        environment variable RTASK_EMBEDDER, else none.
    reader
        Program that reads the words on views; default: that of the extra ``words`` where the
        environment variable RTASK_WORDS is 1, else none.

    Attributes
    ----------
    operations
        By name; see :class:`rtask.engine.operations.operation.Operation`.
    context
        What the operations work with.

    Examples
    --------
    >>> import rtask
    >>> from rtask.engine import Engine
    >>> with rtask.open(":memory:", reason=False) as kb, Engine(kb) as engine:
    ...     sorted(engine.operations)[-2:]
    ['where_is', 'withdraw_contributor']
    """

    operations: Mapping[str, Operation[Any, Any]] = OPERATIONS

    def __init__(
        self,
        kb: GraphCore,
        index_dir: Path | str | None = None,
        policy: Policy | None = None,
        embedder: Path | str | None = None,
        reader: WordReader | None = None,
    ) -> None:
        if kb.plain:
            raise UnsupportedError("a plain knowledge base has no ontology for the engine")
        folder = index_dir
        if folder is None and kb.folder is not None and not kb.refuses_writes:
            folder = kb.folder / "index"
        network = embedder or os.environ.get("RTASK_EMBEDDER")
        self.context = Context(
            kb, None if folder is None else Path(folder), policy or Policy(),
            Path(network) if network else None, reader or reader_by_environment(),
        )  # fmt: skip
        self._listeners: list[Callable[[Call], None]] = []
        self._numbers = itertools.count(1)

    @property
    def kb(self) -> GraphCore:
        """The knowledge base."""
        return self.context.kb

    @property
    def policy(self) -> Policy:
        """Thresholds and weights."""
        return self.context.policy

    @property
    def names(self) -> Names:
        """Source of new IRIs."""
        return self.context.names

    @property
    def grippers(self) -> GripperCatalogue:
        """End effectors that robots registered."""
        return self.context.grippers

    @property
    def classes(self) -> ClassCatalogue:
        """Kinds of objects."""
        return self.context.classes

    @property
    def models(self) -> Models:
        """Models of objects."""
        return self.context.models

    @property
    def index(self) -> RecognitionIndex:
        """Index of views."""
        return self.context.views.index

    def call(
        self, name: str, args: Mapping[str, Any] | None = None, access: Access | None = None
    ) -> Answer:
        """Carry out one operation.

        Parameters
        ----------
        name
            With or without ``/rtask/`` in front.
        args
            The request; unknown fields are refused.
        access
            Access rights of the caller; None = those of the owner.

        Returns
        -------
        The answer, with fields as attributes or by their names in JSON; ``as_json()`` returns
        dictionaries.

        Raises
        ------
        UnknownTermError
            No such operation, gripper, object ...
        UsageError
            The request does not fit the operation.
        ForbiddenError
            The caller has no right to it.
        MissingExtraError
            The operation needs a library of an extra that is not installed.
        """
        operation = self.operations.get(name.removeprefix("/").removeprefix("rtask/"))
        if operation is None:
            raise UnknownTermError(f"no operation {name!r}{nearest(name, list(self.operations))}")
        access = access or Access()
        self.context.require(access, operation.scope)
        with naming_extras(operation.name):
            if not self._listeners:
                answer: Answer = operation.carry_out(self.context, args or {}, access)
                return answer
            return self._call(operation, args or {}, access)

    def on_call(self, listener: Callable[[Call], None]) -> Callable[[], None]:
        """Call back when a call begins and when it ends, in the thread of the caller.

        Returns
        -------
        A function that removes the listener.
        """
        self._listeners.append(listener)

        def stop() -> None:
            with contextlib.suppress(ValueError):
                self._listeners.remove(listener)

        return stop

    def _call(
        self, operation: Operation[Any, Any], args: Mapping[str, Any], access: Access
    ) -> Answer:
        """Carry out an operation and tell the listeners."""
        call = Call(next(self._numbers), operation.name, access)
        self._tell(call)
        try:
            answer: Answer = operation.carry_out(self.context, args, access)
        except Exception as error:
            self._tell(replace(call, error=error))
            raise
        self._tell(replace(call, answer=answer))
        return answer

    def _tell(self, call: Call) -> None:
        for listener in tuple(self._listeners):
            listener(call)

    def rebuild_index(self, progress: Progress | None = None) -> int:
        """Rebuild the index from the graph; return the number of views.

        Parameters
        ----------
        progress
            Called with how many views are read and how many there are.
        """
        return self.context.views.rebuild(progress)

    def keep_compared(self) -> None:
        """Compare stored views in the background, so that no request has to wait for it."""
        self.context.views.keep_compared()

    def rebuild_statistics(self) -> Commit:
        """Recount all grasps from their attempts."""
        return rebuild(self.context)

    def rebuild_models(self, progress: Progress | None = None) -> int:
        """Rebuild the models of all objects from their views; return their number.

        Parameters
        ----------
        progress
            Called with how many objects are done and how many there are.
        """
        return rebuild_models(self.context, progress)[1]

    def read_words(self, progress: Progress | None = None) -> tuple[int, int, int]:
        """Read the words on stored views that nobody has read.

        Returns
        -------
        int, int, int
            Views read, words on them, and views whose picture cannot be read.

        Raises
        ------
        UsageError
            There is no reader.
        """
        return read_stored_views(self.context, progress)

    def close(self) -> None:
        """Close the index; the knowledge base stays open."""
        self.context.close()

    def __enter__(self) -> Engine:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
