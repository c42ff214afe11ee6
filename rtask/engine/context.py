"""The context of an operation: knowledge base, policy, catalogues, index and caches."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rtask.engine.decision_log import FILE, DecisionLog
from rtask.engine.grippers import GripperCatalogue
from rtask.engine.honesty import HonestyCatalogue
from rtask.engine.names import Names
from rtask.engine.networks.embeddings import Embeddings
from rtask.engine.networks.printed_words import PrintedWords
from rtask.engine.observation import Observation
from rtask.engine.policy import Policy
from rtask.engine.population import PopulationCatalogue
from rtask.engine.stored import Models, Recent
from rtask.engine.terms import ClassCatalogue, TermCatalogue, failure_reasons
from rtask.engine.upkeep import Upkeep
from rtask.engine.view_index import ViewIndex
from rtask.errors import ForbiddenError
from rtask.kb.commit.access import Access
from rtask.rdf.namespaces import RDF, RT
from rtask.rdf.terms import NamedNode
from rtask.world import world_of

if TYPE_CHECKING:
    import datetime as dt
    from collections.abc import Callable, Mapping

    from features.words.word import WordReader
    from rtask.kb.commit.commit import Change, Commit
    from rtask.kb.core import GraphCore

__all__ = ["SCOPES", "Context"]

SCOPES: Mapping[str, frozenset[str]] = {
    "reader": frozenset({"read"}),
    "robot": frozenset({"read", "write"}),
    "teacher": frozenset({"read", "write", "teach"}),
    "anonymous": frozenset({"read", "write", "teach"}),
    "admin": frozenset({"read", "write", "teach"}),
}
"""Scopes of each role."""

_OBSERVATIONS, _DECISIONS = 32, 2048
_QUIET_S = 0.2


class Context:
    """Shared state of the operations on one knowledge base.

    Parameters
    ----------
    kb
        Knowledge base with the ontology and the union of graphs.
    index_folder
        Where the index of views is kept; None = in memory.
    embedder
        ONNX file of a network that proposes objects; None = none.
    policy
        Thresholds and weights.
    reader
        Program that reads the words on views; None = they are not read.

    Attributes
    ----------
    writing
        Lock under which IRIs are minted and statements made and stored.
    planning
        Lock under which one plan for a goal is made at a time.
    names, grippers, classes, functions, honesty, population
        Catalogues, refreshed after each commit.
    reasons
        Codes of the outcome reasons of the ontology.
    views
        Index of stored views for recognition.
    words
        Words on views; None where they are not read.
    models
        Decoded models of objects.
    world
        What is where: single things, their places in time, and frames.
    observations
        Recent observations by digest; a robot sends a view twice, to ask and to report.
    decisions
        Recent decisions by task, so that an outcome can be stored with its reasons. In the folder
        of the knowledge base they outlast the process, but for the recognition they rest on.
    headings
        Direction of the x axis of recent objects, rad, by the robot that saw them.
    pass_on
        Takes what is recorded on the way, with its author, where the graph is the copy of another
        server's; None = it is stored here.
    refusals
        Latest refusals that were passed on, and may not be in the copy yet.
    """

    def __init__(
        self,
        kb: GraphCore,
        index_folder: Path | None,
        policy: Policy,
        embedder: Path | None = None,
        reader: WordReader | None = None,
    ) -> None:
        self.kb = kb
        self.policy = policy
        self.writing = threading.RLock()
        self.planning = threading.Lock()
        self.names = Names(kb)
        self.grippers = GripperCatalogue(kb)
        self.classes = ClassCatalogue(kb)
        self.functions = TermCatalogue(kb, RT.ObjectFunction)
        self.colours = TermCatalogue(kb, RT.Colour)
        self.traits = TermCatalogue(kb, RT.ObjectTrait)
        self.honesty = HonestyCatalogue(kb)
        self.population = PopulationCatalogue(kb, self.grippers, self.honesty)
        self.reasons = failure_reasons(kb)
        self.models = Models(kb)
        self.world = world_of(kb)
        self.observations: Recent[Observation] = Recent(_OBSERVATIONS)
        self.decisions = DecisionLog(_file_of_decisions(kb), _DECISIONS)
        self.headings: Recent[float] = Recent(_DECISIONS)
        self.pass_on: Callable[[dict[str, Any], Access], None] | None = None
        self.refusals: Recent[tuple[NamedNode, dt.datetime]] = Recent(_DECISIONS)
        embeddings = None if embedder is None else Embeddings(kb, embedder, self.writing)
        self.views = ViewIndex(kb, index_folder, self.writing, embeddings)
        self.words = None if reader is None else PrintedWords(kb, reader)
        self._learning: Upkeep | None = None
        self._stop_listening = kb.on_commit(self._on_commit)
        self.views.sync()

    def be_copy(
        self, pass_on: Callable[[dict[str, Any], Access], None], quiet_s: float = _QUIET_S
    ) -> None:
        """Be the context of a copy: records are passed on, and views are learned as they come.

        Parameters
        ----------
        pass_on
            See the attribute.
        quiet_s
            Time without a commit about views after which new ones are learned.
        """
        self.pass_on = pass_on
        self._learning = Upkeep("rtask-copy", self._learn_views, quiet_s)
        self._learning.announce()

    def _learn_views(self) -> int:
        self.views.sync()
        return 0

    def require(self, access: Access, scope: str) -> None:
        """Refuse a caller whose role lacks a scope.

        Raises
        ------
        ForbiddenError
            The message names the scope.
        """
        if scope not in SCOPES[access.role]:
            raise ForbiddenError(f"needs scope {scope}; the role {access.role} lacks it")

    def author(
        self, access: Access, fallback: str | None, role: Literal["robot", "teacher"] = "robot"
    ) -> Access:
        """Return the identity under which something is written.

        A caller without a name (a server without tokens, the owner of the store) writes in the name
        of the robot or person in the message, with no more rights than these have, except that it
        may say what others did or confirmed.
        """
        if access.agent or not fallback:
            return access
        return Access(fallback, role, of_owner=True)

    def agent_iri(self, author: Access) -> NamedNode:
        """Return the individual of an author in the graph."""
        if author.agent is None:
            return self.names.named("agent", "anonymous")
        role = "teacher" if author.role == "teacher" else "robot"
        return self.kb.graphs.agent_iri(author.agent, role)

    def home_graph(self, author: Access) -> NamedNode:
        """Return the graph that an author writes to."""
        home = author.bind(self.kb.graphs).home()
        assert isinstance(home, NamedNode)
        return home

    def commit_id(self, commit: Commit) -> str:
        """Return the id of a commit in the form used in messages."""
        return f"c-{commit.seq:05d}"

    def close(self) -> None:
        """Close the index; the knowledge base stays open."""
        self._stop_listening()
        if self._learning is not None:
            self._learning.close()
        self.views.close()
        self.decisions.close()

    def _on_commit(self, change: Change) -> None:
        self.grippers.forget_if_changed(change)
        self.classes.forget_if_changed(change)
        for terms in (self.functions, self.colours, self.traits):
            terms.forget_if_changed(change)
        self.honesty.forget_if_changed(change)
        self.population.forget_if_changed(change)
        self.names.forget_new()
        if self._learning is not None and self._is_about_views(change):
            self._learning.announce()

    def _is_about_views(self, change: Change) -> bool:
        """Whether views came or went, or an object that has some has another class."""
        for quad in (*change.added, *change.removed):
            if quad.predicate in (RT.hasView, RT.viewContent):
                return True
            if quad.predicate == RDF.type and self.kb.match(quad.subject, RT.hasView):
                return True
        return False


def _file_of_decisions(kb: GraphCore) -> Path | None:
    """Return where decisions outlast the process, or None where nothing may be written."""
    return None if kb.folder is None or kb.refuses_writes else kb.folder / FILE
