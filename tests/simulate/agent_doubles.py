"""For tests of agents: objects in view, plans and records, without physics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from features.geometry import Frame, Intrinsics
from features.perception import Seen
from features.tabletop import TabletopShape
from rtask.interop.episodes.motion import Motion
from simulate.grasping.judgement import Judgement

__all__ = ["CAMERA", "Plan", "Record", "seen_at"]

CAMERA = Intrinsics.from_fov(16, 12, 1.2)


def seen_at(x: float, y: float) -> Seen:
    """Return an object of 3 x 3 x 7 cm that stands at a place, m, base frame."""
    shape = TabletopShape(np.array([x, y]), 0.0, 0.03, 0.03, 0.07, 0.27, np.zeros((4, 2)), 0.95)
    crop = Frame(np.full((12, 16), 0.3, np.float32), CAMERA, np.zeros((12, 16, 3), np.uint8))
    return Seen(crop, np.ones((12, 16), bool), np.full((30, 3), [x, y, 0.3]), shape, False)


_PLACED = Judgement("yes")


@dataclass(frozen=True)
class Record:
    """The part of :class:`simulate.grasping.executor.GraspRecord` that the agent reads."""

    reason: str = "ok"
    held: bool = True
    placed: bool = True
    judged_placed: Judgement = _PLACED
    evidence: str = "held: yes (opening 0.50 -> 0.50 -> 0.50)"
    jaw_gap_m: float = 0.025
    place_reason: str = "ok"
    place: str = "right box"
    lifted_m: float = 0.06
    slip_m: float = 0.001
    duration_s: float = 6.0
    links_touching: int = 6
    contact_force_n: float = 3.0
    preset: str = "faithful"
    seed: int = 0
    end_effector: str = "right_hand"
    motion: Motion | None = None

    @property
    def kept(self) -> bool:
        """Whether it was not lost on the way."""
        return self.held and self.place_reason != "slip_transport"


@dataclass(frozen=True)
class Plan:
    """A way to a grasp that can be reached, well or not."""

    request: Any
    is_doubtful: bool = False
