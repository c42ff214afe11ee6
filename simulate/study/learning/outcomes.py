"""Simulated outcomes of many grasps of many objects, on which learners are replayed.

Each object stands alone at its true pose. Some grasps are proposed from geometry, others are drawn
blindly, and if none of them holds, more are tried. Each is executed from the same initial state, so
that the outcome of any later choice is known: all learners face the same world, and another seed
needs no further simulation.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from features.perception import perceive
from features.recognition.views.view import describe_frame
from grasp.learning.state import pooled
from grasp.spatial.footprint import Footprint
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.planar import PlanarGrasp, propose_planar, rate
from rtask.scratch import ScratchFolder
from simulate.agent.scoring import AttemptTruth
from simulate.agent.simulated_body import Conditions, SimulatedBody
from simulate.grasping.executor import GraspRequest, PlannedGrasp
from simulate.grasping.record import UNREACHABLE, is_counted
from simulate.world.camera import Lighting
from simulate.world.objects import KINDS, ObjectSpec, product
from simulate.world.scene import Placement, arrange
from simulate.world.seeds import mix_seed, stream

__all__ = ["outcome_trial"]

_PRODUCT, _PLACE, _LIGHT, _NOISE, _BLIND, _PLAN = range(20, 26)
_PRODUCTS_OF_A_KIND = 200
_DIRECTIONS = 12
_DRAWS = 3  # at most so many draws for each grasp wanted: some cannot be reached
_SETTLE_S = 0.3


def outcome_trial(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Try several grasps of one object; return each with its outcome, as JSON data."""
    seed = int(settings["seed"])
    kind = KINDS[number % len(KINDS)]
    side = -1 if (number // len(KINDS)) % 2 == 0 else 1
    spec = product(kind, int(stream(seed, _PRODUCT, number).integers(_PRODUCTS_OF_A_KIND)))
    (placement,) = arrange([spec], stream(seed, _PLACE, number), [side])
    conditions = Conditions(
        preset=str(settings["preset"]),
        lighting=Lighting.sample(stream(seed, _LIGHT, number)),
        noise_seed=(seed, _NOISE, number),
    )
    with ScratchFolder("assets") as assets:
        body = SimulatedBody([placement], assets, conditions)
        try:
            bench = _Bench(body, placement, mix_seed(seed, _PLAN, number))
            look = _look(body, "right" if side < 0 else "left")
            blind, most = stream(seed, _BLIND, number), int(settings["most"])
            arms = [
                *bench.try_some("geometry", bench.proposed(), int(settings["proposed"]), most),
                *bench.try_some("blind", bench.blind(blind), int(settings["blind"]), most),
            ]
        finally:
            body.close()
    held = sum(arm["reason"] == "ok" for arm in arms)
    tried = sum(is_counted(arm["reason"]) for arm in arms)
    return {
        "product": spec.name,
        "kind": kind,
        "size": [bench.shape.length, bench.shape.width, bench.shape.height],
        "look": look,
        "arms": arms,
        "says": f"{spec.name}: {held} of {tried} held",
    }


class _Bench:
    """One object that is put back to its first place before every grasp."""

    def __init__(self, body: SimulatedBody, placement: Placement, seed: int) -> None:
        self.body, self.placement, self.seed = body, placement, seed
        self.gripper = _gripper(body)
        self.shape = _shape(placement)
        self._side = "right" if placement.y < 0 else "left"

    def proposed(self) -> Iterator[PlanarGrasp]:
        """Yield the candidates of geometry, best first, each position and direction once."""
        aims: set[tuple[float, ...]] = set()
        for grasp in propose_planar(self.shape, self.gripper, seed=self.seed):
            aim = (round(grasp.x, 4), round(grasp.y, 4), round(grasp.theta, 4))
            if aim not in aims:
                aims.add(aim)
                yield grasp

    def blind(self, rng: np.random.Generator) -> Iterator[PlanarGrasp]:
        """Yield grasps anywhere over the object's bounding box, in any direction."""
        shape = self.shape
        along = np.array([math.cos(shape.yaw), math.sin(shape.yaw)])
        across = np.array([-along[1], along[0]])
        half = np.array([shape.length, shape.width]) / 2
        while True:
            a, b = rng.uniform(-half, half)
            x, y = np.asarray(shape.centre) + a * along + b * across
            theta = shape.yaw + int(rng.integers(_DIRECTIONS)) * math.pi / _DIRECTIONS
            height = float(np.clip(0.5 * shape.height, 0.008, 0.045))
            yield PlanarGrasp(
                float(x), float(y), height, theta % math.pi, 0.0, self.gripper.max_opening, 0.0,
                seed=self.seed,
            )  # fmt: skip

    def try_some(
        self, source: str, grasps: Iterator[PlanarGrasp], required: int, most: int
    ) -> list[dict[str, Any]]:
        """Execute the first ``wanted`` reachable grasps, and more until one of them holds.

        The limit is ``most``, the number of attempts after which a learner gives up an object.
        """
        tried: list[dict[str, Any]] = []
        missed = 0
        for grasp in grasps:
            made = len(tried) - missed
            enough = made >= required and any(arm["reason"] == "ok" for arm in tried)
            if enough or made >= most or missed > (_DRAWS - 1) * required:
                break
            tried.append(self._try(source, grasp, len(tried)))
            missed += not is_counted(tried[-1]["reason"])
        return tried

    def _try(self, source: str, grasp: PlanarGrasp, number: int) -> dict[str, Any]:
        rated = rate(self.shape, self.gripper, grasp)
        contacts = self.shape.contacts((grasp.x, grasp.y), grasp.theta, self.gripper.finger_width)
        width = self.shape.width if contacts is None else contacts.width
        outcome = self._outcome(grasp, width, mix_seed(self.seed, number))
        x, y = self._in_object(grasp)
        return {
            "source": source,
            "x": round(x, 6),
            "y": round(y, 6),
            "z": round(grasp.z, 6),
            "theta": round((grasp.theta - self.shape.yaw) % math.pi, 6),
            "quality": 0.0 if rated is None else round(float(rated.quality), 6),
            **outcome,
        }

    def _outcome(self, grasp: PlanarGrasp, width: float, seed: int) -> dict[str, Any]:
        body, shape = self.body, self.shape
        self._put_back()
        request = GraspRequest(
            x=grasp.x, y=grasp.y, z=body.world.table_height + grasp.z, theta=grasp.theta,
            width=width, opening=grasp.opening, height=shape.height, length=shape.length,
            table_height=body.world.table_height, arm=self._side,
            round=shape.kind == "round",
        )  # fmt: skip
        plan = body.executor.plan(request, seed=seed)
        if isinstance(plan, PlannedGrasp):
            watch = AttemptTruth(body.world, body.robot, plan)
            record = body.executor.execute(plan, watch, place=False)
            return {
                "reason": watch.truth.reason or record.reason,
                "doubtful": plan.is_doubtful,
            }
        judged = plan in ("too_wide", "too_heavy")
        return {"reason": plan if judged else UNREACHABLE, "doubtful": False, "why": plan}

    def _put_back(self) -> None:
        """Replace the object by a new one at its first place, at rest."""
        world = self.body.world
        for old in list(world.objects):
            world.remove(old)
        at = self.placement
        world.spawn(at.spec, (at.x, at.y), at.yaw)
        world.step(_SETTLE_S)

    def _in_object(self, grasp: PlanarGrasp) -> tuple[float, float]:
        dx, dy = grasp.x - self.shape.centre[0], grasp.y - self.shape.centre[1]
        cos, sin = math.cos(self.shape.yaw), math.sin(self.shape.yaw)
        return cos * dx + sin * dy, cos * dy - sin * dx


def _gripper(body: SimulatedBody) -> ParallelGripper:
    arm = body.robot.arm("right")
    return ParallelGripper(arm.end_effector, arm.gripper_type, 0.0, arm.mouth)


def _shape(placement: Placement) -> Footprint:
    """Return the true footprint of a product, the longer side along its yaw."""
    spec: ObjectSpec = placement.spec
    along, across, height = spec.extent
    yaw = placement.yaw
    if across > along:
        along, across, yaw = across, along, yaw + math.pi / 2
    is_round = spec.kind in ("can", "ball", "bottle")
    return Footprint(
        (placement.x, placement.y), yaw % math.pi, along, across, height, float(is_round)
    )


def _look(body: SimulatedBody, side: str) -> list[float]:
    """Return the object's view as pooled descriptors; zeros if it was not seen."""
    frame, base_from_camera = body.look(side)
    seen = perceive(frame, base_from_camera, body.ignored).objects
    descriptors = describe_frame(seen[0].crop).descriptors if seen else np.zeros((0, 128))
    values, _ = pooled(np.asarray(descriptors, dtype=np.float64))
    return [round(float(v), 5) for v in values]
