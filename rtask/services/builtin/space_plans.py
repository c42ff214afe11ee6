"""Grasps in space as a service, so that workers on many machines share the objects of a batch.

One call is one object; the answer holds arrays as they are, so that it equals a plan made here.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Gt, Le

from rtask.errors import ServiceError
from rtask.services.service import Service, method, startup
from rtask.wire.message import Answer
from rtask.wire.types import Array, Bytes, Flag, Json, Number, Text, Unit, Whole

if TYPE_CHECKING:
    from grasp.batch import BatchPlan, MeshFile, Planned
    from grasp.spatial.candidate import GraspCandidate

__all__ = ["NAME", "SpacePlans", "planned_from", "request_for"]

NAME = "rtask/SpacePlans"
_ARRAYS: Mapping[str, tuple[int, ...]] = {
    "frame_from_gripper": (4, 4),
    "contacts": (-1, 3),
    "normals": (-1, 3),
    "features": (-1,),
}


class SpaceGrasp(Answer):
    """One grasp of an object, in the frame of its mesh."""

    frame_from_gripper: Array
    """pose of the gripper, the 16 numbers of a (4, 4) matrix by rows; z approaches, x closes"""
    width: Annotated[float, Unit("m")]
    """distance between the contacts"""
    depth: Annotated[float, Unit("m")]
    """how far the fingertips reach past the first surface"""
    contacts: Array | None = None
    """points that jaws or fingers touch, x, y, z each, m; null for a cup or where not known"""
    normals: Array | None = None
    """out of the object at the contacts; null where they are not known"""
    source: str
    """what it was found on"""
    antipodal: str
    """full, half or none"""
    completed: bool
    """whether the far side was completed by symmetry"""
    opening: Annotated[float, Unit("m")] | None = None
    """distance of the jaws before closing; null where it was not checked"""
    scores: Json
    """confidence, lower_95, epsilon and others"""
    features: Array | None = None
    """what a learner sees; null where there are none"""


class SpacePlan(Answer):
    """Grasps of one object, best first."""

    grasps: list[SpaceGrasp]
    reason: str
    """why there are none; empty where there are"""
    notes: list[str]
    """what was done to the mesh"""
    counts: Json
    """how many candidates were tried and what became of them"""
    advice: str
    """what would help where there are none"""
    error: str
    """why the mesh cannot be used; empty where it can"""


class SpacePlans(Service):
    """Grasps in space of meshes, ranked by their confidence under an uncertain pose."""

    name = NAME
    version = "1.0.0"
    extra = "perception"
    timeout_s = 300.0

    @startup
    def compile(self) -> None:
        """Compile the kernels; they are kept on disk."""
        from grasp.spatial.grasp_plan import warm_up

        warm_up()

    @method
    def plan(
        self,
        mesh: Bytes,
        kind: Literal["stl", "obj", "ply"],
        gripper: Json | None = None,
        position_std: Annotated[Number, Unit("m"), Ge(0)] | None = None,
        rotation_std: Annotated[Number, Unit("rad"), Ge(0)] | None = None,
        samples: Annotated[Whole, Ge(1), Le(10_000)] = 100,
        mass: Annotated[Number, Unit("kg"), Gt(0)] | None = None,
        tries: Annotated[Whole, Ge(1), Le(100_000)] = 2000,
        grasps: Annotated[Whole, Ge(1), Le(1000)] = 50,
        scale: Annotated[Number, Gt(0)] = 1.0,
        floating: Flag = False,
        name: Text = "mesh",
        seed: Annotated[Whole, Ge(0)] = 0,
    ) -> SpacePlan:
        """Plan grasps of a mesh that stands on its lowest vertex, z up.

        Parameters
        ----------
        mesh
            Contents of the file.
        kind
            Its format.
        gripper
            As a gripper file has it, of jaws, a suction cup or three fingers; default: that of the
            Panda.
        position_std
            Standard deviation of the object's position; default: that of `rtask grasp space`.
        rotation_std
            Standard deviation of its rotation; default: that of `rtask grasp space`.
        samples
            Perturbed poses for each candidate.
        mass
            Of the object; default: its weight is not known, and is guessed for the order.
        tries
            Points drawn on the mesh.
        grasps
            How many to return at most.
        scale
            Metres per unit of the file.
        floating
            Without a support below the object.
        name
            Of the file, for messages.
        seed
            Of every draw; the same seed gives the same answer.
        """
        from grasp.batch import BatchPlan, MeshFile
        from grasp.spatial.grasp_plan import SpatialOptions
        from grasp.spatial.gripper import panda_hand
        from grasp.spatial.gripper_files import end_effector_from_data
        from grasp.spatial.scoring.confidence import PoseNoise

        usual = PoseNoise()
        noise = PoseNoise(
            usual.position_std if position_std is None else position_std,
            usual.rotation_std if rotation_std is None else rotation_std,
        )
        try:
            hand = panda_hand() if gripper is None else end_effector_from_data(gripper)
        except ValueError as error:
            raise ServiceError(f"gripper: {error}", field="gripper") from error
        options = SpatialOptions(
            noise=noise, samples=samples, mass=mass, tries=tries, most=grasps, seed=seed
        )
        file = MeshFile(name, kind, mesh)
        planned = BatchPlan((file,), hand, options, scale, floating).plan(file)
        plans = planned.proposals
        return SpacePlan(
            grasps=[_sent(grasp) for grasp in plans], reason=plans.reason, notes=list(plans.notes),
            counts=dict(plans.counts), advice=plans.advice, error=planned.error,
        )  # fmt: skip


def request_for(batch: BatchPlan, file: MeshFile) -> dict[str, Any]:
    """Return the plan of one mesh of a batch as a request carries it.

    Raises
    ------
    ServiceError
        The batch says something that a request cannot.
    """
    from grasp.spatial.gripper_files import end_effector_to_data

    given = batch.options
    if given.reachable is not None or (given.quality, given.weighting) != ("closure", "plain"):
        raise ServiceError("reachable, quality and weighting cannot be sent to a server")
    noise = given.noise
    if noise.covariance is not None:
        raise ServiceError("a covariance of the pose cannot be sent to a server")
    return {
        "mesh": base64.b64encode(file.contents).decode("ascii"), "kind": file.kind,
        "gripper": end_effector_to_data(batch.gripper),
        "position_std": noise.position_std, "rotation_std": noise.rotation_std,
        "samples": given.samples, "tries": given.tries, "grasps": given.most,
        "scale": batch.scale, "floating": batch.floating, "name": file.name, "seed": given.seed,
        **({} if given.mass is None else {"mass": given.mass}),
    }  # fmt: skip


def planned_from(answer: Mapping[str, Any], name: str) -> Planned:
    """Return the plan that an answer as JSON holds."""
    from grasp.batch import Planned
    from grasp.spatial.candidate import GraspCandidate, Proposals

    candidates = []
    for grasp in answer["grasps"]:
        fields = {key: value for key, value in grasp.items() if value is not None}
        for key, shape in _ARRAYS.items():
            if key in fields:
                fields[key] = np.array(fields[key], dtype=np.float64).reshape(shape)
        candidates.append(GraspCandidate(**fields))
    proposals = Proposals(
        tuple(candidates), answer["reason"], tuple(answer["notes"]), answer["counts"],
        answer["advice"],
    )  # fmt: skip
    return Planned(name, proposals, answer["error"])


def _sent(grasp: GraspCandidate) -> SpaceGrasp:
    arrays: dict[str, Any] = {
        name: None if (value := getattr(grasp, name)) is None else np.ravel(value)
        for name in _ARRAYS
    }
    return SpaceGrasp(
        **arrays, width=float(grasp.width), depth=float(grasp.depth), source=grasp.source,
        antipodal=grasp.antipodal, completed=bool(grasp.completed),
        opening=None if grasp.opening is None else float(grasp.opening),
        scores={name: float(value) for name, value in grasp.scores.items()},
    )  # fmt: skip
