"""The context of an operation: knowledge base, policy, catalogues, index and caches."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from rtask.engine.decisions import Decision
from rtask.engine.embeddings import Embeddings
from rtask.engine.grippers import GripperCatalogue
from rtask.engine.honesty import HonestyCatalogue
from rtask.engine.names import Names
from rtask.engine.observation import Observation
from rtask.engine.policy import Policy
from rtask.engine.stored import Models, Recent
from rtask.engine.terms import ClassCatalogue, FunctionCatalogue, known_reasons
from rtask.engine.view_index import ViewIndex
from rtask.errors import ForbiddenError
from rtask.kb.commit.access import Access
from rtask.rdf.terms import NamedNode

if TYPE_CHECKING:
    from collections.abc import Mapping

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
    embedder
        ONNX file of a network whose vectors propose objects; None = none.

    Attributes
    ----------
    writing
        Lock under which IRIs are minted and statements made and stored.
    names, grippers, classes, functions, honesty
        Catalogues, refreshed after each commit.
    reasons
        Codes of the outcome reasons of the ontology.
    views
        Index of stored views for recognition.
    models
        Decoded models of objects.
    observations
        Recent observations by digest; a robot sends a view twice, to ask and to report.
    decisions
        Recent decisions by task, so that an outcome can be stored with its reasons. Kept in memory
        only: after a restart an outcome is stored without them.
    """

    def __init__(
        self,
        kb: GraphCore,
        index_folder: Path | None,
        policy: Policy,
        embedder: Path | None = None,
    ) -> None:
        self.kb = kb
        self.policy = policy
        self.writing = threading.RLock()
        self.names = Names(kb)
        self.grippers = GripperCatalogue(kb)
        self.classes = ClassCatalogue(kb)
        self.functions = FunctionCatalogue(kb)
        self.honesty = HonestyCatalogue(kb)
        self.reasons = known_reasons(kb)
        self.models = Models(kb)
        self.observations: Recent[Observation] = Recent(_OBSERVATIONS)
        self.decisions: Recent[Decision] = Recent(_DECISIONS)
        embeddings = None if embedder is None else Embeddings(kb, embedder, self.writing)
        self.views = ViewIndex(kb, index_folder, self.writing, embeddings)
        self._stop_listening = kb.on_commit(self._on_commit)
        self.views.sync()

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
        of the robot or person in the message, with no more rights than these have.
        """
        if access.agent or not fallback:
            return access
        return Access(fallback, role)

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
        self.views.close()

    def _on_commit(self, change: Change) -> None:
        self.grippers.forget_if_changed(change)
        self.classes.forget_if_changed(change)
        self.functions.forget_if_changed(change)
        self.honesty.forget_if_changed(change)
        self.names.forget_new()
