"""Push grasps of planar parts under uncertainty as a service (Kehoe 2014, 5.8 and chapter 3)."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from rtask.errors import ServiceError
from rtask.services.call import Call
from rtask.services.service import Service, method, startup
from rtask.wire.message import Answer
from rtask.wire.types import Array, ArrayOf, Carried, Number, Unit, Whole

__all__ = ["Grasping", "PlannedPush", "PushGrasps"]

Polygon = Annotated[
    NDArray[np.float64],
    ArrayOf(2, "m", 500, "[x, y]"),
    Carried("string", "Sequence[Sequence[float]]", None),
]
Length = Annotated[Number, Unit("m"), Ge(0)]


class PlannedPush(Answer):
    """One push grasp: the first jaw pushes the part, then the second closes."""

    contact: Annotated[Array, Unit("m")]
    """point of the outline that the pushing jaw is centred on"""
    approach: Array
    """direction in which the pushing jaw moves, a unit vector"""
    opening: Annotated[float, Unit("m")]
    """distance of the jaws that the part needs"""
    probability: float
    """share of the perturbed parts on which the grasp closes"""
    lower_95: float
    """lower 95 % bound of that probability"""
    whisker_end: Annotated[Array, Unit("m")]
    """outer end of its whisker, which starts at the contact (Kehoe 2014, Fig. 3.9)"""


class PushGrasps(Answer):
    """Push grasps of a part, best first."""

    grasps: list[PlannedPush]
    candidates: int
    """how many were tried"""
    jaw_width: Annotated[float, Unit("m")]
    """of the gripper"""
    vertex_std: Annotated[float, Unit("m")]
    """standard deviation of a vertex"""
    samples: int
    """perturbed parts that were judged"""


class Grasping(Service):
    """Push grasps of planar parts, ranked by their probability of force closure."""

    name = "example/Grasping"
    version = "1.2.0"
    extra = "perception"

    @startup
    def compile(self) -> None:
        """Compile the kernels; they are kept on disk."""
        from grasp.push import warm_up

        warm_up()

    @method(effect="reads")
    def plan(
        self,
        polygon: Polygon,
        call: Call,
        position_std: Length = 0.0,
        rotation_std: Annotated[Number, Unit("rad"), Ge(0)] = 0.0,
        grasps: Annotated[Whole, Ge(1), Le(100)] = 10,
        jaw_width: Length | None = None,
        max_opening: Length | None = None,
        friction: Annotated[Number, Ge(0), Le(5)] = 0.7,
        vertex_std: Length | None = None,
        samples: Annotated[Whole, Ge(1), Le(10_000)] = 100,
        method: Literal["bound", "simulation"] = "bound",
        seed: Annotated[Whole, Ge(0)] = 0,
        deadline: Annotated[Number, Unit("s"), Gt(0)] | None = None,
    ) -> PushGrasps:
        """Plan grasps of a part whose pose and shape are uncertain.

        Parameters
        ----------
        polygon
            Outline of the part, [[x, y], ...] in m, in its own frame.
        position_std
            Standard deviation of its lateral position.
        rotation_std
            Standard deviation of its rotation.
        grasps
            How many to return at most.
        jaw_width
            Of the gripper; default: a quarter of the diameter of the part.
        max_opening
            Stroke of the gripper; default: as wide as needed.
        friction
            Coefficient between jaw and part.
        vertex_std
            Standard deviation of a vertex; default: 0.045 radii of the part.
        samples
            Number of perturbed parts.
        method
            How a grasp is judged on one of them: by a lower bound, or by quasi-static simulation.
        seed
            Of the perturbations; the same seed gives the same answer.
        deadline
            After this time the answer rests on the perturbed parts that have been judged by then;
            default: on all.
        """
        from grasp.push import as_part, plan_push_grasps
        from grasp.push.figures.whiskers import whisker_segments

        def tell(done: int, total: int) -> None:
            call.progress(done / total, f"{done} of {total} perturbed parts")

        try:
            width = 0.25 * as_part(polygon).diameter if jaw_width is None else jaw_width
            plan = plan_push_grasps(
                polygon, jaw_width=width, friction=friction, vertex_std=vertex_std,
                pose_std=(position_std, rotation_std), samples=samples, method=method,
                max_opening=max_opening, seed=seed, progress=tell, deadline_s=deadline,
            )  # fmt: skip
        except ValueError as error:
            raise ServiceError(str(error)) from error
        ends = whisker_segments(plan)[:, 1]
        ranked = [_push(plan, i, ends[i]) for i in plan.analysis.order[:grasps].tolist()]
        return PushGrasps(
            grasps=ranked, candidates=len(plan.grasps), jaw_width=width,
            vertex_std=float(plan.tolerance.vertex_std), samples=plan.analysis.samples,
        )  # fmt: skip


def _push(plan: Any, index: int, whisker_end: NDArray[np.float64]) -> PlannedPush:
    analysis, grasps = plan.analysis, plan.grasps
    return PlannedPush(
        contact=grasps.contacts[index],
        approach=grasps.approaches[index],
        opening=float(plan.openings[index]),
        probability=float(analysis.quality[index]),
        lower_95=float(analysis.lower_95[index]),
        whisker_end=whisker_end,
    )
