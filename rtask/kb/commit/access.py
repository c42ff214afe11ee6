"""Access rights: which caller may read and write which graph.

Writing is decided on the exact delta of a commit; reading, by the server that answers a request.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal as OneOf
from typing import TypeAlias
from urllib.parse import unquote

from pyoxigraph import Quad

import ontology
from rtask.errors import ForbiddenError, UsageError
from rtask.kb.store.graphs import Graphs
from rtask.rdf.terms import DEFAULT, DefaultGraph, GraphName, NamedNode

__all__ = ["RIGHTS", "Access", "Role", "actor_of", "names_doer", "unnamed_person"]

Role: TypeAlias = OneOf["reader", "robot", "teacher", "admin", "anonymous"]
RIGHTS = frozenset(("rules", "replicate", "deploy", "schema"))
_READ = "read:"
_GRAPH = re.compile(r"read:[A-Za-z][A-Za-z0-9+.\-]*:[^\s<>\"{}|\\^`\x00-\x20]+")
_DOERS = {
    # The last one implies prov:wasAttributedTo, so that it names a doer all the same.
    "rt": "performedBy activates acquiredBy knownBy calibratesHand refusedWith graphOwner",
    "prov": "wasAssociatedWith wasAttributedTo agent actedOnBehalfOf",
    "sosa": "madeBySensor",
}
_DONE_BY = frozenset(
    ontology.PREFIXES[prefix] + name for prefix, names in _DOERS.items() for name in names.split()
)
"""Properties whose value is who did, saw or answers for something, or the hand or camera used."""
_ROLES = ("reader", "robot", "teacher", "admin", "anonymous")


def actor_of(quad: Quad, graphs: Graphs) -> tuple[bool, str] | None:
    """Return who did, saw or judged something by a statement: whether a person, and the name.

    None for a statement that says nothing of the kind, or names somebody of another base.
    """
    named = quad.object
    if quad.predicate.value not in _DONE_BY or not isinstance(named, NamedNode):
        return None
    for folder in ("robot", "person"):
        start = f"{graphs.base}{folder}/"
        if named.value.startswith(start):
            name = unquote(named.value.removeprefix(start).partition("/")[0])
            return folder == "person", name
    return None


def names_doer(predicate: NamedNode) -> bool:
    """Whether the value of a property is who did something, or with which hand."""
    return predicate.value in _DONE_BY


def unnamed_person(agent: str) -> str:
    """Return the name of whoever confirms an outcome through a robot, unnamed.

    Names of tokens have no spaces, so that it can never be that of somebody with a token.

    >>> unnamed_person("nao-1")
    'operator of nao-1'
    """
    return f"operator of {agent}"


@dataclass(frozen=True)
class Access:
    """Rights of one caller.

    Parameters
    ----------
    agent
        Name of the robot or person, or ``None``.
    role
        ``reader`` writes nothing; ``robot`` and ``teacher`` write their own agent graph;
        ``anonymous`` (a server without tokens) writes everything unprotected but ontologies;
        ``admin`` writes everything unprotected.
    rights
        What the caller may do beyond its role. ``rules``: add and remove rules of the reasoner,
        which of the roles only an ``admin`` may. ``schema``: state axioms about terms that are not
        the caller's own, which robots and teachers may not by their role; see
        :mod:`rtask.kb.commit.schema_right`. ``replicate``: copy the whole knowledge base,
        tokens included, as a follower does. ``deploy``: carry out calls of services, as a worker
        does. ``read:<IRI>``, for a ``reader`` only and with no other kind of right: read that named
        graph, and no graph for which it has no such right.
    of_owner
        Whether the program that opened the store acts in the agent's name, which it may do for any.

    Examples
    --------
    >>> access = Access("nao-1", "robot").bind(Graphs("urn:lab/"))
    >>> access.may_write(NamedNode("urn:lab/graph/agent/nao-1"))
    True
    >>> access.may_write(NamedNode("urn:lab/graph/agent/nao-2"))
    False
    """

    agent: str | None = None
    role: Role = "admin"
    rights: frozenset[str] = frozenset()
    graphs: Graphs | None = field(default=None, compare=False, repr=False)
    is_ontology: Callable[[GraphName], bool] | None = field(default=None, compare=False, repr=False)
    plain: bool = field(default=False, compare=False, repr=False)
    of_owner: bool = field(default=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        if self.role not in _ROLES:
            raise UsageError(f"unknown role {self.role!r}; one of {', '.join(_ROLES)}")
        if self.role in ("robot", "teacher") and not self.agent:
            raise UsageError(f"a {self.role} needs a name")
        if not self.rights <= RIGHTS:
            self._check_reading()

    def _check_reading(self) -> None:
        """Refuse rights that do not exist, and rights to read that others would void."""
        graphs = {right for right in self.rights if _GRAPH.fullmatch(right)}
        unknown = self.rights - RIGHTS - graphs
        if unknown:
            rights = ", ".join((*sorted(RIGHTS), "read:<IRI of a graph>"))
            raise UsageError(f"unknown right {min(unknown)!r}; one of {rights}")
        if self.role != "reader":
            raise UsageError(
                f"{min(graphs)!r} limits what is read, and a {self.role} may read all; "
                "give it to a reader"
            )
        # A right to read some graphs is void beside one that reads everything.
        if self.rights != graphs:
            other = min(self.rights - graphs)
            raise UsageError(f"{other!r} reads all graphs; give it and {min(graphs)!r} apart")

    @cached_property
    def reads(self) -> frozenset[str] | None:
        """IRIs of the only graphs that this caller may read; none if it may read all."""
        graphs = (right for right in self.rights if right.startswith(_READ))
        return frozenset(right.removeprefix(_READ) for right in graphs) or None

    @property
    def may_state_axioms(self) -> bool:
        """Whether this caller may state axioms about any term."""
        return self.role not in ("robot", "teacher") or "schema" in self.rights or self.plain

    @property
    def may_decide(self) -> bool:
        """Whether this caller may adopt and refuse proposals."""
        return self.role in ("admin", "anonymous") or "schema" in self.rights

    def bind(
        self,
        graphs: Graphs,
        is_ontology: Callable[[GraphName], bool] | None = None,
        plain: bool = False,
    ) -> Access:
        """Return the same rights, applied to one knowledge base."""
        return replace(self, graphs=graphs, is_ontology=is_ontology, plain=plain)

    def home(self) -> GraphName:
        """Return the graph that a statement without a graph goes to."""
        if self.plain:
            return DEFAULT
        graphs = self._bound()
        # Unnamed callers share a graph, so that what they state has a place of its own.
        return graphs.agent(self.agent) if self.agent else graphs.shared

    def may_write(self, graph: GraphName) -> bool:
        """Whether this caller may change the graph."""
        if self.role == "reader":
            return False
        if self.plain:
            return True
        graphs = self._bound()
        # Before the role: not even an administrator writes what the reasoner derives.
        if not isinstance(graph, NamedNode) or graphs.is_system(graph):
            return False
        if graph == graphs.rules:
            return self.role == "admin" or "rules" in self.rights
        if self.role in ("robot", "teacher"):
            return graphs.owner(graph) == self.agent
        if self.role == "anonymous":
            # An open server lets anybody add data, but not change what all data mean.
            return self.is_ontology is None or not self.is_ontology(graph)
        return True

    def require_write(self, graph: GraphName, operation: str) -> None:
        """Raise unless this caller may change the graph.

        Raises
        ------
        ForbiddenError
            Naming the graph and the operation.
        """
        if self.may_write(graph):
            return
        name = "the default graph" if isinstance(graph, DefaultGraph) else str(graph)
        who = f"{self.role} {self.agent}" if self.agent else self.role
        protected = not self.plain and self._bound().is_system(graph)
        if protected:
            reason = "only the knowledge base itself writes it"
        elif not self.plain and graph == self._bound().rules:
            reason = "adding and removing rules is a right of its own; ask an admin for it"
        elif self.role in ("robot", "teacher"):
            reason = f"it may write {self.home()} only"
        else:
            reason = "its role does not allow it"
        raise ForbiddenError(
            f"{operation}: {who} may not write {name}; {reason}",
            graph=getattr(graph, "value", None),
            operation=operation,
            protected=protected,
        )

    def require_own_identity(self, quad: Quad, graphs: Graphs) -> None:
        """Raise if a caller states what another robot or person did, saw or judged.

        Raises
        ------
        ForbiddenError
            Naming the statement and the agent.
        """
        acting = actor_of(quad, graphs)
        if self.of_owner or acting is None:
            return
        name = acting[1]
        # Whoever stands beside the robot may confirm, and is called its operator.
        if name in (self.agent, unnamed_person(self.agent or "")):
            return
        raise ForbiddenError(
            f"the token belongs to {self.agent!r}: it cannot state {quad.predicate} "
            f"{getattr(quad.object, 'value', quad.object)}, which is {name!r}",
            statement=f"{quad.subject} {quad.predicate} {quad.object}",
        )

    def _bound(self) -> Graphs:
        if self.graphs is None:
            raise UsageError("bind the access to a knowledge base first: access.bind(kb.graphs)")
        return self.graphs
