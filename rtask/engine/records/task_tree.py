"""Task trees: what a robot set out to do, what it tried for that, and what it did then.

Attempts of one episode, which a robot numbers 1, 2, 3 ..., are parts of one ``rt:PickAndPlace``:
each by its own task, in their order (``rt:precedes``), and, where the robot says whether the object
arrived, an ``rt:Place`` that the same attempt carried out, with the place where it was put.
"""

from __future__ import annotations

from typing import TYPE_CHECKING
from urllib.parse import quote

from rtask.engine.triples import Triples
from rtask.rdf.namespaces import PREFIXES, RDF, RT
from rtask.rdf.terms import NamedNode, iri

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.engine.records.attempts import Attempt

__all__ = ["is_place_of", "parts_of", "place_iri", "state_task_tree"]

_PART = "/place"


def place_iri(robot: NamedNode, name: str) -> NamedNode:
    """Return the IRI of a place by the name that a robot gives it.

    Two robots that name a place alike may mean two places.
    """
    return NamedNode(f"{robot.value}/place/{quote(name, safe='')}")


def is_place_of(robot: NamedNode, node: NamedNode) -> bool:
    """Tell whether a node is a place that a robot named."""
    return node.value.startswith(f"{robot.value}/place/")


def state_task_tree(context: Context, triples: Triples, attempt: Attempt) -> None:
    """Add the task that an attempt is part of, its order there, and the placing."""
    robot, number = attempt.gripper.robot, attempt.outcome.report.attempt_number
    before = None if number is None or number == 1 else _before(context, attempt, number - 1)
    if before is None:
        whole = context.names.unique("task")
        _state_task(triples, whole, RT.PickAndPlace, "pick_and_place", attempt)
    else:
        whole, last = before
        triples.add(last, RT.precedes, attempt.task)
    triples.add(whole, RT.hasSubTask, attempt.task)
    if attempt.outcome.placed is None or not attempt.outcome.held:
        return
    placing = iri(attempt.task.value + _PART)
    _state_task(triples, placing, RT.Place, "place", attempt)
    triples.add(whole, RT.hasSubTask, placing)
    triples.add(attempt.task, RT.precedes, placing)
    triples.add(placing, RT.carriedOutBy, attempt.attempt)
    if attempt.outcome.report.place:
        name = attempt.outcome.report.place
        place = place_iri(robot, name)
        triples.node(place, [RT.SupportSurface], {RT.name: name})
        frame = NamedNode(f"{robot.value}/frame/{quote(name, safe='')}")
        if context.kb.match(frame, RDF.type, RT.Frame):
            triples.add(place, RT.bodyFrame, frame)  # the robot told where this place is
        triples.add(placing, RT.targetSurface, place)


def parts_of(task: NamedNode) -> tuple[NamedNode, NamedNode]:
    """Return the task of an attempt and its placing, which there may not be."""
    return task, iri(task.value + _PART)


def _state_task(
    triples: Triples, task: NamedNode, kind: NamedNode, name: str, attempt: Attempt
) -> None:
    robot = attempt.gripper.robot
    triples.node(
        task, [kind], {RT.taskName: name, RT.assignedTo: robot, RT.handles: attempt.object_iri}
    )


def _before(context: Context, attempt: Attempt, number: int) -> tuple[NamedNode, NamedNode] | None:
    """Return the whole and the part of the robot's last attempt of this number at the object."""
    if context.names.is_new(attempt.object_iri):
        return None
    rows = context.kb.select(f"""{PREFIXES}
SELECT ?whole ?task WHERE {{
  ?task rt:handles {attempt.object_iri} ; rt:through ?attempt .
  ?attempt rt:performedBy {attempt.gripper.robot} ; rt:attemptNumber {number} ;
    prov:endedAtTime ?ended .
  ?whole rt:hasSubTask ?task
}} ORDER BY DESC(?ended) DESC(?task) LIMIT 1""")
    for row in rows:
        whole, task = row["whole"], row["task"]
        if isinstance(whole, NamedNode) and isinstance(task, NamedNode):
            return whole, task
    return None
