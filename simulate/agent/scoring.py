"""Ground truth, used only to score afterwards; nothing here is reachable from the agent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from simulate.agent.encounter import Encounter
from simulate.agent.perception import Seen
from simulate.grasping.executor import GraspRequest

if TYPE_CHECKING:
    from simulate.agent.simulated_body import SimulatedBody

__all__ = ["Judge"]

_ANGLES = np.deg2rad(np.arange(0, 180, 15))
_SPARE_M = 0.004  # a hand needs some room to go round an object whose place it knows to 2 mm
_UPRIGHT_AND_ROUND = frozenset({"can", "ball", "bottle"})


class Judge:
    """Knows which body is which product and which of them the robot can reach at all."""

    def __init__(self, body: SimulatedBody) -> None:
        self._body = body
        self._products = {laid.body: laid.placement.spec.name for laid in body.laid}

    def body_under(self, seen: Seen) -> int:
        """Return the body that most pixels of a segment show; -1 = none of the products."""
        ids, counts = np.unique(self._body.last_labels[seen.mask], return_counts=True)
        best = int(ids[np.argmax(counts)])
        return best if best in self._products else -1

    def in_reach(self) -> dict[int, bool]:
        """Return for each body whether a grasp of its true shape fits and can be planned."""
        return {laid.body: self._reachable(laid.body) for laid in self._body.laid}

    def _reachable(self, body: int) -> bool:
        world, executor = self._body.world, self._body.executor
        spec = next(laid.placement.spec for laid in self._body.laid if laid.body == body)
        pose = world.object_pose(body)
        along_x, along_y, height = spec.extent
        mouth = min(arm.mouth for arm in self._body.robot.arms.values())
        for offset in _ANGLES if spec.kind in _UPRIGHT_AND_ROUND else (np.pi / 2, 0.0):
            if (along_y if offset else along_x) > mouth - _SPARE_M:
                continue
            request = GraspRequest(
                x=pose.x,
                y=pose.y,
                theta=float((pose.yaw + offset) % np.pi),
                width=along_y if offset else along_x,
                height=height,
                length=max(along_x, along_y),
                table_height=world.table_height,
                round=spec.kind in _UPRIGHT_AND_ROUND,
            )
            if not isinstance(executor.plan(request, obstacles=[], seed=0), str):
                return True
        return False

    def score(
        self,
        met: Sequence[Encounter],
        first_sight: Mapping[int, int],
        in_reach: Mapping[int, bool],
    ) -> list[dict[str, Any]]:
        """Return the encounters as JSON data, each with its product.

        ``right`` is filled in by :mod:`simulate.demo`, which alone knows which product an object
        IRI of the graph stands for.
        """
        scored = []
        for encounter in met:
            body = first_sight.get(encounter.number, -1)
            scored.append(
                {
                    **encounter.summary(),
                    "product": self._products.get(body, ""),
                    "in_reach": bool(in_reach.get(body, False)),
                    "right": None,
                }
            )
        return scored
