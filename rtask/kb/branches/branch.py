"""A branch of a graph: a graph of its own to read and write, to compare, to merge or to drop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import TracebackType
from typing import Any, Generic, Self, TypeVar

from pyoxigraph import NamedNode, Quad

from rtask.errors import ConflictError, RtaskError
from rtask.kb.branches.comparison import Comparison, Conflict, conflicts_of, refusal_of
from rtask.kb.branches.record import BranchRecord
from rtask.kb.branches.register import BranchRegister
from rtask.kb.branches.touched import MAX_TOUCHED, Touched
from rtask.kb.commit.access import Access
from rtask.kb.commit.commit import Commit, Request
from rtask.kb.proposals.trial import try_change
from rtask.kb.store.naming import Names
from rtask.kb.writing import Writing
from rtask.rdf.terms import GraphName

__all__ = ["Branch"]

G = TypeVar("G", bound=Writing)


class Branch(Generic[G]):
    """A branch that is open; made by :meth:`KnowledgeBase.branch`.

    As a context manager it is closed at the end of the block, and stays until it is merged,
    dropped, or expires. One that was made without a name is dropped there.

    Attributes
    ----------
    graph
        The state of the branch: query, write, reason and simulate on it as on its trunk.
    record
        Its name, author, base, and when it expires.

    Examples
    --------
    >>> import rtask, tempfile
    >>> folder = tempfile.TemporaryDirectory()
    >>> kb = rtask.open(folder.name, reason=False, ontologies=False)
    >>> with kb.branch("tidy") as branch:
    ...     _ = branch.graph.update("INSERT DATA { <urn:cup> <urn:on> <urn:shelf> }")
    ...     kb.query("ASK { <urn:cup> ?p ?o }"), len(branch.compare().added)
    ...     commit = branch.merge()
    (False, 1)
    >>> kb.query("ASK { <urn:cup> ?p ?o }"), kb.branches()
    (True, [])
    >>> kb.close(); folder.cleanup()
    """

    def __init__(
        self,
        trunk: G,
        graph: G,
        record: BranchRecord,
        touched: tuple[Touched, Touched],
        register: BranchRegister,
        temporary: bool,
    ) -> None:
        self._trunk = trunk
        self._own, self._others = touched
        self._register = register
        self._is_temporary = temporary
        self.graph = graph
        self.record = record

    @property
    def name(self) -> str:
        """Name of the branch."""
        return self.record.name

    @property
    def base(self) -> int:
        """Number of the trunk's commit on which it rests."""
        return self.record.base

    def compare(self, *, agent: str | None = None, access: Access | None = None) -> Comparison:
        """Return what merging would do, and what stands against it; nothing is stored.

        Parameters
        ----------
        agent, access
            With whose rights it would be merged.

        Raises
        ------
        UnsupportedError, TooLargeError
            The trunk was loaded in bulk since, or has changed too much to compare.
        """
        request = self._request(self._trunk.access(agent, access))
        with self.graph.writer.exclusive():
            try:
                # Compared by trying the merge and giving it up, so that it says what a merge would
                # meet.
                return self._trunk.writer.commit_repeatably(
                    lambda again, _: self._compared(again), replace(request, strict=True)
                )
            except RtaskError as error:
                return self._compared(None, refusal_of(error))

    def _compared(self, request: Request | None, refusal: Sequence[Conflict] = ()) -> Comparison:
        """Return what merging would do by a trial of it, or with the reason why it is refused."""
        trunk = self._trunk.writer
        overlay = trunk.begin()
        try:
            conflicts = self._conflicts()
            net = self._own.net
            for quad in net.removed:
                overlay.remove(quad)
            overlay.add_all(net.added)
            trial = None if request is None else try_change(trunk.committer, overlay, request)
            return Comparison(
                self.record,
                tuple(net.added),
                tuple(net.removed),
                trial.derived if trial else None,
                trial.withdrawn if trial else None,
                self.graph.seq - self.base,
                self._trunk.seq - self.base,
                (*conflicts, *refusal),
                trial.violations if trial else (),
            )
        finally:
            trunk.cancel()

    def merge(
        self, *, agent: str | None = None, access: Access | None = None, note: str | None = None
    ) -> Commit:
        """Carry all that the branch has changed out on the trunk, as one commit; drop the branch.

        Parameters
        ----------
        agent, access
            Who merges; must be allowed to write each graph that the branch has changed.
        note
            Stored with the commit; by default it names the branch.

        Raises
        ------
        ConflictError
            The trunk has changed since so that they do not fit; ``conflicts`` lists why.
        InconsistentError
            Together they contradict each other; names the statements. The branch stays.
        RtaskError
            As :meth:`KnowledgeBase.update`; the branch stays.
        """
        rights = self._trunk.access(agent, access)
        with self.graph.writer.exclusive():
            request = self._request(rights, note or self._note())
            with self._trunk.commit_block(request) as tx:
                conflicts = self._conflicts()
                if conflicts:
                    more = f" (and {len(conflicts) - 1} more)" if len(conflicts) > 1 else ""
                    raise ConflictError(
                        f"branch {self.name} does not fit what the trunk holds now: "
                        f"{conflicts[0].message}{more}; nothing was merged",
                        conflicts=[conflict.to_dict() for conflict in conflicts],
                    )
                # Only the net change: a statement made and withdrawn in the branch leaves no trace
                # in the trunk.
                tx.remove_quads(self._own.net.removed, as_read=True)
                tx.add_quads(self._own.net.added)
        self._register.remove(self.name)
        return tx.commit

    def touched_quads(self) -> list[Quad]:
        """Return the statements of the branch that the trunk may not hold."""
        with self.graph.writer.exclusive(), self._trunk.writer.exclusive():
            self._own.catch_up()
            self._others.catch_up()
            return [*self._own.net.added, *self._others.net.removed]

    def _note(self) -> str:
        author = f" of {self.record.author}" if self.record.author else ""
        commits = self.graph.seq - self.base
        return f"merge of branch {self.name}{author}, {commits} commits since {self.base}"

    def drop(self, *, agent: str | None = None, access: Access | None = None) -> None:
        """Delete the branch with all that was written in it.

        Raises
        ------
        ForbiddenError
            Somebody else made it, and the caller is no admin.
        """
        self.record.require_may_drop(self._trunk.access(agent, access))
        self._register.remove(self.name)

    def close(self) -> None:
        """Close the branch, which stays until it is merged, dropped, or expires."""
        self._register.close(self.name)

    def _conflicts(self) -> list[Conflict]:
        self._own.catch_up()
        self._others.catch_up()
        names = Names(self._trunk.store, self._trunk.graphs)
        return conflicts_of(self._trunk.store, self._own.net, self._others.net, names)

    def _request(self, rights: Access, note: str | None = None) -> Request:
        return Request(rights, note=note, kinds=self._kinds(), max_quads=MAX_TOUCHED)

    def _kinds(self) -> dict[GraphName, str]:
        """Return the class of the graphs of the branch that are ontologies."""
        self._own.catch_up()
        graphs = {quad.graph_name for quad in self._own.net.added}
        is_ontology = self.graph.catalogue.is_ontology
        ontologies = (g for g in graphs if isinstance(g, NamedNode) and is_ontology(g))
        return dict.fromkeys(ontologies, "OntologyGraph")

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-able values: the record, and the number of its last commit."""
        return self.record.to_dict() | {"seq": self.graph.seq}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._is_temporary:
            self._register.remove(self.name)
        else:
            self.close()

    def __repr__(self) -> str:
        return f"<Branch {self.name} of {self._trunk!r} after commit {self.base}>"
