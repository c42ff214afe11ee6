"""Table of all operations by name.

An operation is declared in a file of its own and listed here. After a declaration has changed, make
the typed client again: ``python -m rtask.engine.operations.table > rtask/client/calls.py``.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

from rtask.engine.operations.clutter import plan_on_scene
from rtask.engine.operations.contributors import compare_contributors, withdraw_contributor
from rtask.engine.operations.curate import curate_object
from rtask.engine.operations.feedback import give_feedback
from rtask.engine.operations.grasps import recall_grasps
from rtask.engine.operations.insert import insert_object
from rtask.engine.operations.mesh import reconstruct_mesh
from rtask.engine.operations.motions import recall_motions
from rtask.engine.operations.operation import Operation
from rtask.engine.operations.outcome import report_outcome
from rtask.engine.operations.planned import plan_in_space
from rtask.engine.operations.recognise import recognise_for_grasp
from rtask.engine.operations.refusal import report_refusal
from rtask.engine.operations.resolution.resolve import resolve_request
from rtask.engine.operations.robots import register_robot
from rtask.engine.operations.search import search_object
from rtask.engine.operations.tasks.plan import plan_goal, store_plan
from rtask.engine.operations.tasks.questions import answer_question, ask_person, list_questions
from rtask.engine.operations.tasks.queue import cancel_plan, claim_step, end_step, list_plans
from rtask.engine.operations.tasks.why import explain_failure
from rtask.engine.operations.teach import teach_object
from rtask.engine.operations.world.frames import locate_frame, state_frame
from rtask.engine.operations.world.reach import state_reach
from rtask.engine.operations.world.scene import show_world
from rtask.engine.operations.world.sightings import report_sightings
from rtask.engine.operations.world.state import state_place
from rtask.engine.operations.world.trace import trace_thing
from rtask.engine.operations.world.where import where_is
from rtask.wire.stubs import source_of

__all__ = ["OPERATIONS", "client_source"]

_ALL: tuple[Operation[Any, Any], ...] = (
    register_robot,
    recognise_for_grasp,
    recall_grasps,
    recall_motions,
    plan_in_space,
    plan_on_scene,
    reconstruct_mesh,
    search_object,
    resolve_request,
    where_is,
    state_place,
    state_reach,
    report_sightings,
    trace_thing,
    show_world,
    locate_frame,
    state_frame,
    plan_goal,
    store_plan,
    list_plans,
    claim_step,
    end_step,
    cancel_plan,
    ask_person,
    list_questions,
    answer_question,
    explain_failure,
    insert_object,
    report_outcome,
    report_refusal,
    give_feedback,
    teach_object,
    curate_object,
    compare_contributors,
    withdraw_contributor,
)
OPERATIONS: Mapping[str, Operation[Any, Any]] = {operation.name: operation for operation in _ALL}
"""All operations by name."""


def client_source() -> str:
    """Return the source of ``rtask/client/calls.py``."""
    return source_of(OPERATIONS.values(), "rtask.engine.operations.table")


if __name__ == "__main__":
    sys.stdout.write(client_source())
