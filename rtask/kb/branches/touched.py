"""Triples that the commits after one have touched, followed as further commits come."""

from __future__ import annotations

from rtask.errors import TooLargeError, UnsupportedError
from rtask.kb.durability.journal import JournalFile
from rtask.kb.feed.as_of import may_lack_some, records_after
from rtask.kb.store.graphs import Graphs
from rtask.kb.store.overlay import NetChange
from rtask.rdf.terms import GraphName, NamedNode, TripleKey, triple_key

__all__ = ["MAX_TOUCHED", "Touched"]

MAX_TOUCHED = 500_000
"""Triples on which a branch and its trunk may differ while the branch is written."""


class Touched:
    """Net change of the commits of a journal after one.

    Parameters
    ----------
    journal, graphs
        Of the graph whose commits are followed.
    base
        Number of the commit after which they count.
    name
        What has made the commits, for errors.

    Attributes
    ----------
    net
        What has been added to and removed from the graphs that people and robots write.
    asserted, inferred
        Triples of the reasoner's input, and of what it has derived, that came or went.
    seq
        Number of the last commit that is counted.
    """

    def __init__(self, journal: JournalFile, graphs: Graphs, base: int, name: str) -> None:
        self._journal = journal
        self._graphs = graphs
        self._name = name
        self.net = NetChange()
        self.asserted: dict[TripleKey, None] = {}
        self.inferred: dict[TripleKey, None] = {}
        self.seq = base

    def catch_up(self) -> None:
        """Count the commits that were made since the last call.

        Raises
        ------
        UnsupportedError
            One of them was a bulk load, whose statements the journal does not hold.
        TooLargeError
            More has changed than is followed.
        """
        for record in records_after(self._journal, self.seq):
            if may_lack_some(record):
                raise UnsupportedError(
                    f"commit {record.seq} of {self._name} was loaded in bulk, which a branch "
                    "cannot follow; drop the branch, and make it anew",
                    commit=record.seq,
                )
            change = NetChange()
            for part, quads in (
                (change.removed, record.removed()),
                (change.added, record.added()),
            ):
                for quad in quads:
                    graph = quad.graph_name
                    if graph == self._graphs.inferred:
                        self.inferred[triple_key(quad)] = None
                    elif self.is_own(graph):
                        part[quad] = None
                        if self._graphs.is_input(graph):
                            self.asserted[triple_key(quad)] = None
            self.net.join(change)
            self.seq = record.seq
            if len(self.asserted) + len(self.inferred) > MAX_TOUCHED:
                raise TooLargeError(
                    f"more than {MAX_TOUCHED} triples have changed in {self._name} since the "
                    "branch was made; drop it, and make it anew",
                    limit="statements",
                    allowed=MAX_TOUCHED,
                )

    def is_own(self, graph: GraphName) -> bool:
        """Whether people and robots write a graph; records, and what is derived, are left out."""
        if not isinstance(graph, NamedNode) or graph == self._graphs.causes:
            return False
        return graph == self._graphs.rules or not self._graphs.is_system(graph)
