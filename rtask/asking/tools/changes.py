"""The tool that changes nothing by itself: it proposes, and somebody with the right decides."""

from __future__ import annotations

from typing import Annotated

from annotated_types import MaxLen
from pydantic import Field
from pyoxigraph import Quad

from rtask.asking.tools.declaration import Asked, tool
from rtask.asking.tools.values import Value
from rtask.errors import RtaskError, UsageError
from rtask.kb.commit.access import Access
from rtask.rdf.terms import NamedNode
from rtask.wire.message import Answer, Message
from rtask.wire.types import Flag, Text

__all__ = ["propose_change"]

MAX_STATEMENTS = 100
MAX_SHOWN = 5
Statement = Annotated[list[str], MaxLen(3)]


class ProposeChange(Message):
    """A change to be decided by somebody with the right to it."""

    add: Annotated[list[Statement], MaxLen(MAX_STATEMENTS)] = Field(default_factory=list)
    """to assert: [subject, property, object]"""
    remove: Annotated[list[Statement], MaxLen(MAX_STATEMENTS)] = Field(default_factory=list)
    """to withdraw"""
    graph: Text | None = None
    """default: the caller's own"""
    reason: Text | None = None
    keep: Flag = True
    """false: only try it"""


class Proposed(Answer):
    """What the change would do, and the number of the proposal; 0 if it was not kept."""

    commit: int
    possible: bool
    """whether it could be stored now, before anybody decides"""
    derived: int
    withdrawn: int
    violations: list[Value]
    """the first five"""
    violations_left_out: int
    refused: Value | None
    proposal: int
    state: str


@tool(
    "Propose a change: it is tried with reasoning and shapes, and waits for a person's decision.",
    {"add": [["kb:object/7", "rt:mass", "0.3"]], "reason": "weighed"},
    {"remove": [['"red mug"', "a", "rt:Mug"]], "keep": False},
    scope="write",
    effect="writes",
)
def propose_change(asked: Asked, request: ProposeChange) -> Proposed:
    """Try a change on the present state, discard that, and keep the change as a proposal."""
    kb, access = asked.kb, asked.access.bind(asked.kb.graphs, asked.kb.catalogue.is_ontology)
    home = access.home()
    graph = asked.resource(request.graph) if request.graph is not None else home
    if not isinstance(graph, NamedNode):
        raise UsageError("graph is missing: name the graph of the statements")
    added = [_quad(asked, part, graph) for part in request.add]
    removed = [_quad(asked, part, graph) for part in request.remove]
    if not (added or removed):
        raise UsageError("the proposal changes nothing; give add or remove")
    refused: Value | None = None
    derived = withdrawn = 0
    violations: list[Value] = []
    left_out = 0
    try:
        trial = kb.try_change(added, removed, access=Access())
    except RtaskError as error:
        refused = asked.terms.text(str(error), ["the trial, quoting the graph"])
    else:
        derived, withdrawn = trial.derived, trial.withdrawn
        shown = trial.violations[:MAX_SHOWN]
        left_out = len(trial.violations) - len(shown)
        violations = [
            asked.terms.text(str(part), ["the shapes, quoting the graph"]) for part in shown
        ]
    number, state = 0, "not kept"
    if request.keep and refused is None:
        author = access.agent or access.role
        proposal = kb.propose(added, removed, author=author, reason=request.reason or "")
        number, state = proposal.number, proposal.state
    return Proposed(
        commit=kb.seq,
        possible=refused is None,
        derived=derived,
        withdrawn=withdrawn,
        violations=violations,
        violations_left_out=left_out,
        refused=refused,
        proposal=number,
        state=state,
    )


def _quad(asked: Asked, statement: list[str], graph: NamedNode) -> Quad:
    if len(statement) != 3:
        raise UsageError("a statement has three parts: [subject, property, object]")
    subject, predicate, value = asked.statement(*statement)
    assert isinstance(subject, NamedNode)
    return Quad(subject, predicate, value, graph)
