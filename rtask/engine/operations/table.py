"""The operations of the engine: what a robot or person may ask for, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rtask.engine.operations.curate import CURATE_OBJECT, curate_object
from rtask.engine.operations.feedback import GIVE_FEEDBACK, give_feedback
from rtask.engine.operations.grasps import RECALL_GRASPS, recall_grasps
from rtask.engine.operations.insert import INSERT_OBJECT, insert_object, wrapped
from rtask.engine.operations.messages import Field
from rtask.engine.operations.outcome import REPORT_OUTCOME, report_outcome
from rtask.engine.operations.planned import PLAN_IN_SPACE, plan_in_space
from rtask.engine.operations.recognise import RECOGNISE_FOR_GRASP, recognise_for_grasp
from rtask.engine.operations.resolve import RESOLVE_REQUEST, resolve_request
from rtask.engine.operations.robots import REGISTER_ROBOT, register_robot
from rtask.engine.operations.search import search_object
from rtask.engine.operations.teach import SEARCH_OBJECT, TEACH_OBJECT, teach_object

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access

__all__ = ["OPERATIONS", "Handler", "Operation"]

Handler = Callable[["Context", dict[str, Any], "Access"], dict[str, Any]]


@dataclass(frozen=True)
class Operation:
    """One operation.

    Parameters
    ----------
    name
        On the wire, ``/rtask/<name>`` and ``/engine/<name>``.
    scope
        That a caller needs.
    summary
        One line.
    handler
        Takes the context, the checked request and the caller's rights.
    fields
        Of the request.
    prepare
        Brings other accepted spellings of a request into its proper form.
    """

    name: str
    scope: str
    summary: str
    handler: Handler
    fields: tuple[Field, ...]
    prepare: Callable[[dict[str, Any]], dict[str, Any]] = lambda args: args


OPERATIONS: Mapping[str, Operation] = {
    operation.name: operation
    for operation in (
        Operation(
            "register_robot", "write", "introduce a robot: grippers, cameras, frames",
            register_robot, REGISTER_ROBOT,
        ),
        Operation(
            "recognise_for_grasp", "read", "name an object and the grasps to try, in order",
            recognise_for_grasp, RECOGNISE_FOR_GRASP,
        ),
        Operation(
            "recall_grasps", "read", "list the known grasps of a known object",
            recall_grasps, RECALL_GRASPS,
        ),
        Operation(
            "plan_in_space", "write", "plan grasps in space of a known object and store them",
            plan_in_space, PLAN_IN_SPACE,
        ),
        Operation(
            "search_object", "read", "list known objects that look like this one",
            search_object, SEARCH_OBJECT,
        ),
        Operation(
            "resolve_request", "read", "choose a seen object that serves a request, and its grasps",
            resolve_request, RESOLVE_REQUEST,
        ),
        Operation(
            "insert_object", "write", "store what was seen and what came of grasping it",
            insert_object, INSERT_OBJECT, wrapped,
        ),
        Operation(
            "report_outcome", "write", "store what came of a grasp on a known object",
            report_outcome, REPORT_OUTCOME,
        ),
        Operation(
            "give_feedback", "teach", "confirm, correct or refuse what a robot reported",
            give_feedback, GIVE_FEEDBACK,
        ),
        Operation(
            "teach_object", "read", "search by words, name an object, confirm or reject a grasp",
            teach_object, TEACH_OBJECT,
        ),
        Operation(
            "curate_object", "teach", "merge two objects, split one, forget one, take it back",
            curate_object, CURATE_OBJECT,
        ),
    )
}  # fmt: skip
"""All operations by name."""
