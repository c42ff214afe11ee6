"""Data resources as services see them: folders of files, and the knowledge graph."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rtask.errors import ForbiddenError, MissingDataError, UnsupportedError, UsageError
from rtask.kb.branches.branching import Branching
from rtask.kb.commit.access import Access
from rtask.services.call import Ending

if TYPE_CHECKING:
    from pyoxigraph import Quad

    from rtask.kb.branches.branch import Branch
    from rtask.kb.branches.record import BranchRecord
    from rtask.kb.commit.commit import Change, Commit
    from rtask.kb.core import GraphCore
    from rtask.rdf.terms import NamedNode, Subject, Value

__all__ = ["Files", "GraphBranches", "GraphResource", "Resource", "WritableFiles"]


class Files:
    """The files of a dataset, as a folder that may be read.

    Parameters
    ----------
    name
        Of the dataset, with its version: ``robots/NAO@3``.
    folder
        Where the files are.
    """

    def __init__(self, name: str, folder: Path) -> None:
        self.name = name
        self.folder = folder

    def path(self, name: str) -> Path:
        """Return the path of a file by its name in the dataset, ``/model``.

        Raises
        ------
        MissingDataError
            The dataset has no such file.
        """
        path = (self.folder / name.lstrip("/")).resolve()
        if not path.is_relative_to(self.folder.resolve()) or not path.exists():
            raise MissingDataError(f"{self.name} has no file {name}; it has {self._names()}")
        return path

    def read(self, name: str) -> bytes:
        """Return the contents of a file."""
        return self.path(name).read_bytes()

    def _names(self) -> str:
        files = [file for file in self.folder.rglob("*") if file.is_file()]
        names = sorted(f"/{file.relative_to(self.folder)}" for file in files)
        return ", ".join(names[:10]) or "none"


class WritableFiles(Files):
    """The files of the head of a dataset, to which a call may write.

    What a call writes is stored when it returns, all of it or, if it fails, nothing.
    """

    def __init__(self, name: str, folder: Path) -> None:
        super().__init__(name, folder)
        self._written: dict[str, bytes] = {}

    def write(self, name: str, data: bytes) -> None:
        """Write a file by its name in the dataset."""
        self._written[name.lstrip("/")] = bytes(data)

    def read(self, name: str) -> bytes:
        """Return the contents of a file, also of one that this call wrote."""
        written = self._written.get(name.lstrip("/"))
        return super().read(name) if written is None else written

    def take(self) -> dict[str, bytes]:
        """Return what was written, and forget it."""
        written, self._written = self._written, {}
        return written


class GraphResource:
    """The knowledge graph, read and written with the rights of the caller.

    Parameters
    ----------
    graph
        The graph.
    writable
        Whether the service declared that it writes.

    Attributes
    ----------
    ending
        Of the call that uses it; nothing is written once that has ended. None = of no call.
    """

    def __init__(self, graph: GraphCore, writable: bool) -> None:
        self._graph = graph
        self._writable = writable
        self.ending: Ending | None = None

    @property
    def seq(self) -> int:
        """Number of the newest commit."""
        return self._graph.seq

    def query(self, text: str, **options: Any) -> Any:
        """Answer a SPARQL query; see :meth:`rtask.KnowledgeBase.query`."""
        return self._graph.query(text, **options)

    def ask(self, text: str) -> bool:
        """Answer an ASK query.

        Raises
        ------
        UsageError
            The query is another one.
        """
        answer = self._graph.query(text)
        if not isinstance(answer, bool):
            raise UsageError("expected an ASK query")
        return answer

    def match(
        self,
        subject: Subject | str | None = None,
        predicate: NamedNode | str | None = None,
        value: Value | None = None,
        graph: NamedNode | str | None = None,
    ) -> list[Quad]:
        """Return the statements that match a pattern; None matches everything."""
        return self._graph.match(subject, predicate, value, graph)

    @contextmanager
    def at(self, seq: int) -> Iterator[GraphResource]:
        """Yield the graph as it was after a commit, a copy in memory that nobody changes.

        Several queries of one call that must agree with each other ask the graph at :attr:`seq`.

        Raises
        ------
        UsageError, GoneError, UnsupportedError
            As :meth:`rtask.KnowledgeBase.as_of`.
        """
        with self._graph.as_of(seq) as then:
            yield GraphResource(then, writable=False)

    @property
    def trunk(self) -> GraphBranches:
        """The branches of the graph, on which a service may try what is never to be in the graph.

        Raises
        ------
        UnsupportedError
            The graph is on another server, which has its own branches.
        """
        if not isinstance(self._graph, Branching):
            raise UnsupportedError("this graph has no branches: ask the server that stores it")
        return GraphBranches(self._graph)

    def follow(self, listener: Callable[[Change], None]) -> Callable[[], None]:
        """Call back with each commit from now on; return a function that ends this."""
        return self._graph.on_commit(listener)

    def update(self, text: str, access: Access) -> Commit | None:
        """Carry out a SPARQL update under the name of a caller, ``call.caller``.

        Raises
        ------
        ForbiddenError
            The service did not declare the resource as writable, or the caller may not write.
        CancelledError, DeadlineError
            The call has ended.
        """
        if not self._writable:
            raise ForbiddenError("the service declares its graph as read only")
        if self.ending is None:
            return self._graph.update(text, access=access)
        with self.ending.writing() as commits:
            stored = self._graph.update(text, access=access)
            if stored is not None:
                commits.append(stored.seq)
        return stored


class GraphBranches:
    """The branches of a graph, without the graph itself: what is written there stays there."""

    def __init__(self, graph: Branching) -> None:
        self._graph = graph

    def branch(
        self, name: str | None = None, *, access: Access | None = None,
        lifetime: dt.timedelta | None = None, note: str = "",
    ) -> Branch[Any]:  # fmt: skip
        """Make a branch that begins as the graph is now; see :meth:`rtask.KnowledgeBase.branch`."""
        return self._graph.branch(name, access=access, lifetime=lifetime, note=note)

    def branches(self) -> list[BranchRecord]:
        """Return the branches, the oldest first."""
        return self._graph.branches()

    def drop_branch(self, name: str, *, access: Access | None = None) -> BranchRecord:
        """Delete a branch with all that was written in it."""
        return self._graph.drop_branch(name, access=access)


Resource = Files | GraphResource
