"""The operations of the engine: what a robot or person may ask for, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from rtask.engine.curation.merging import followed
from rtask.engine.operations.curate import Curated, CurateObject, curate_object
from rtask.engine.operations.feedback import Feedback, GiveFeedback, give_feedback
from rtask.engine.operations.grasps import RecalledGrasps, RecallGrasps, recall_grasps
from rtask.engine.operations.insert import Inserted, InsertObject, insert_object
from rtask.engine.operations.outcome import ReportedOutcome, ReportOutcome, report_outcome
from rtask.engine.operations.planned import PlanInSpace, PlannedGrasps, plan_in_space
from rtask.engine.operations.recognise import RecogniseForGrasp, Recognition, recognise_for_grasp
from rtask.engine.operations.resolve import ResolvedRequest, ResolveRequest, resolve_request
from rtask.engine.operations.robots import RegisteredRobot, RegisterRobot, register_robot
from rtask.engine.operations.search import SearchObject, SimilarObjects, search_object
from rtask.engine.operations.teach import Taught, TeachObject, teach_object
from rtask.wire.message import Answer, Message, read

if TYPE_CHECKING:
    from rtask.engine.context import Context
    from rtask.kb.commit.access import Access

__all__ = ["OPERATIONS", "Operation"]

Q = TypeVar("Q", bound=Message)


@dataclass(frozen=True)
class Operation(Generic[Q]):
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
    request, answer
        Their declarations.
    """

    name: str
    scope: str
    summary: str
    handler: Callable[[Context, Q, Access], dict[str, Any]]
    request: type[Q]
    answer: type[Answer]

    def carry_out(
        self, context: Context, args: Mapping[str, Any], access: Access
    ) -> dict[str, Any]:
        """Check a request and answer it; objects that were merged are meant by their old names too.

        Raises
        ------
        UsageError
            The request does not fit the declaration.
        """
        request = read(self.request, dict(args))
        return self.handler(context, followed(context.kb, request), access)


OPERATIONS: Mapping[str, Operation[Any]] = {
    operation.name: operation
    for operation in (
        Operation(
            "register_robot", "write", "introduce a robot: grippers, cameras, frames",
            register_robot, RegisterRobot, RegisteredRobot,
        ),
        Operation(
            "recognise_for_grasp", "read", "name an object and the grasps to try, in order",
            recognise_for_grasp, RecogniseForGrasp, Recognition,
        ),
        Operation(
            "recall_grasps", "read", "list the known grasps of a known object",
            recall_grasps, RecallGrasps, RecalledGrasps,
        ),
        Operation(
            "plan_in_space", "write", "plan grasps in space of a known object and store them",
            plan_in_space, PlanInSpace, PlannedGrasps,
        ),
        Operation(
            "search_object", "read", "list known objects that look like this one",
            search_object, SearchObject, SimilarObjects,
        ),
        Operation(
            "resolve_request", "read", "choose a seen object that serves a request, and its grasps",
            resolve_request, ResolveRequest, ResolvedRequest,
        ),
        Operation(
            "insert_object", "write", "store what was seen and what came of grasping it",
            insert_object, InsertObject, Inserted,
        ),
        Operation(
            "report_outcome", "write", "store what came of a grasp on a known object",
            report_outcome, ReportOutcome, ReportedOutcome,
        ),
        Operation(
            "give_feedback", "teach", "confirm, correct or refuse what a robot reported",
            give_feedback, GiveFeedback, Feedback,
        ),
        Operation(
            "teach_object", "read", "search by words, name an object, confirm or reject a grasp",
            teach_object, TeachObject, Taught,
        ),
        Operation(
            "curate_object", "teach", "merge two objects, split one, forget one, take it back",
            curate_object, CurateObject, Curated,
        ),
    )
}  # fmt: skip
"""All operations by name."""
