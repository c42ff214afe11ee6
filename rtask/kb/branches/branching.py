"""Methods for branches: make, list, open and drop."""

from __future__ import annotations

import datetime as dt
from functools import cached_property
from typing import Self

from rtask.errors import ForbiddenError, UsageError
from rtask.kb.branches.branch import Branch
from rtask.kb.branches.inference import BranchCommitter, BranchInference
from rtask.kb.branches.record import MAX_OPEN, MAX_OPEN_EACH, BranchRecord
from rtask.kb.branches.register import BranchRegister
from rtask.kb.branches.touched import Touched
from rtask.kb.commit.access import Access
from rtask.kb.commit.catalogue import Catalogue
from rtask.kb.commit.writer import Writer
from rtask.kb.durability.blobs import digest_of
from rtask.kb.durability.folder import Files
from rtask.kb.durability.journal import JournalFile
from rtask.kb.feed.as_of import commit_at
from rtask.kb.readers.request import ReaderLimits
from rtask.kb.store.graphs import Graphs
from rtask.kb.writing import Writing
from rtask.rdf.terms import LONG_AGO, NamedNode, moment

__all__ = ["Branching"]

# A branch is for one author at a time, and many may be open: each has few processes of its own.
_READERS = ReaderLimits(count=2, reserved=0, updates=0, queue=8, replica_max=0)


class Branching(Writing):
    """Branches of this graph; see :mod:`rtask.kb.branches`."""

    @cached_property
    def branch_register(self) -> BranchRegister:
        """The records of the branches."""
        return BranchRegister(self._files, self.graphs, self.close_branch)

    @cached_property
    def _open_branches(self) -> dict[str, Branch[Self]]:
        return {}

    def branch(
        self,
        name: str | None = None,
        *,
        at: int | dt.datetime | str | None = None,
        agent: str | None = None,
        access: Access | None = None,
        lifetime: dt.timedelta | None = None,
        note: str = "",
    ) -> Branch[Self]:
        """Make a branch: a graph that begins as this one is and is written by itself.

        It consists of hard links to the files of this one, so it costs no copy whatever the size.

        Parameters
        ----------
        name
            1 to 64 of a-z, 0-9, ``.``, ``_`` and ``-``. Without one, the branch is dropped at the
            end of its ``with`` block.
        at
            Number of the commit after which it begins, or a time; the last one if not given.
        agent, access
            Who makes it, and may drop it later.
        lifetime
            After which it is dropped, at most (and by default) 24 hours.
        note
            What it is for.

        Raises
        ------
        ConflictError
            There is a branch of this name.
        QueueFullError
            16 branches are open, or four of the caller, who is no admin.
        ForbiddenError
            The caller may only read.
        UnsupportedError
            The graph is in memory, on another server, or open for reading.
        UsageError, GoneError, StorageFullError
            As :meth:`as_of`.
        """
        rights = self.access(agent, access)
        if rights.role == "reader":
            raise ForbiddenError("a branch is written, and the caller may only read")
        author = rights.agent or ""
        seq = (
            None
            if at is None
            else at
            if isinstance(at, int)
            else commit_at(self._files, moment(at))
        )
        register = self.branch_register
        # A robot that makes branches without end would fill the disk of all.
        is_free = rights.role == "admin" or rights.of_owner
        max_own = MAX_OPEN if is_free else MAX_OPEN_EACH
        if seq is None or seq == self.seq:
            register.records()  # raises first where no branch is possible
            # Links of the present state need no journal, but nobody may write while they are made.
            with self._writer.exclusive():
                record = register.make(name, author, self.seq, note, lifetime, True, max_own)
        else:
            if not 0 <= seq <= self.seq:
                raise UsageError(f"there is no commit {seq}; the last one is {self.seq}")
            self.feed.require_retained(seq)
            record = register.make(name, author, seq, note, lifetime, False, max_own)
        return self._opened(record, name is None)

    def branches(self) -> list[BranchRecord]:
        """Return the branches of this graph, the oldest first."""
        return self.branch_register.records()

    def open_branch(self, name: str) -> Branch[Self]:
        """Open a branch that was made before.

        Raises
        ------
        UnknownTermError
            There is none of this name, or it has expired.
        """
        return self._opened(self.branch_register.get(name), False)

    def drop_branch(
        self, name: str, *, agent: str | None = None, access: Access | None = None
    ) -> BranchRecord:
        """Delete a branch with all that was written in it; return its record.

        Raises
        ------
        UnknownTermError
            There is none of this name.
        ForbiddenError
            Somebody else made it, and the caller is no admin.
        """
        record = self.branch_register.get(name)
        record.require_may_drop(self.access(agent, access))
        self.branch_register.remove(name)
        return record

    def close_branch(self, name: str) -> None:
        """Close a branch if it is open."""
        branch = self._open_branches.pop(name, None)
        if branch is not None:
            branch.graph.close()

    def close_branches(self) -> None:
        """Close all branches, which stay until they are merged, dropped, or expire."""
        for name in list(self._open_branches):
            self.close_branch(name)

    def blobs_of_branches(self) -> set[str]:
        """Return the digests of the blobs that only branches name, or a state that they rest on.

        Raises
        ------
        StoreFormatError
            The record of a branch is damaged, so nobody knows what it names.
        """
        folder = self._files.folder
        if folder is None or not (folder / "branches").is_dir():
            return set()
        quads = [
            quad
            for record in self.branch_register.records(is_whole=True)
            for quad in self.open_branch(record.name).touched_quads()
        ]
        terms = (term for quad in quads for term in (quad.subject, quad.object))
        digests = (digest_of(term) for term in terms if isinstance(term, NamedNode))
        return {digest for digest in digests if digest is not None}

    def _opened(self, record: BranchRecord, temporary: bool) -> Branch[Self]:
        with self.branch_register.lock:
            there = self._open_branches.get(record.name)
            # One object for a branch, however often it is opened: two would write one journal.
            if there is None:
                files = self.branch_register.open(record)
                try:
                    there = self._connect(files, record, temporary)
                except BaseException:
                    files.abandon()
                    raise
                self._open_branches[record.name] = there
            return there

    def _connect(self, files: Files, record: BranchRecord, temporary: bool) -> Branch[Self]:
        graphs = Graphs(files.settings.base)
        catalogue = Catalogue(files.store, graphs)
        trunk = self._writer.committer
        assert isinstance(files.journal, JournalFile)
        assert isinstance(self._files.journal, JournalFile)
        own = Touched(files.journal, graphs, record.base, "the branch")
        others = Touched(self._files.journal, graphs, record.base, "the trunk")
        inference = None
        if self._inference is not None:
            inference = BranchInference(files.store, graphs, catalogue, self._writer, own, others)
        committer = BranchCommitter(
            files.store,
            graphs,
            files.settings.plain,
            files.blobs,
            catalogue,
            inference,
            files.journal,
            None if trunk.validator is None else trunk.validator.beside(files.store),
            last_seq=max(catalogue.seq, files.last_seq),
            last_time=catalogue.last_time() or LONG_AGO,
            quarantines=trunk.quarantines,
        )
        if inference is not None:
            inference.follow(lambda: committer.last_seq)
        graph = type(self)(files, catalogue, inference, Writer(committer))
        graph.readers.limits = _READERS
        return Branch(self, graph, record, (own, others), self.branch_register, temporary)
