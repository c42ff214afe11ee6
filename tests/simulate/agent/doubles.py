"""For tests of agents: a body, a server, objects in view, plans and records, without physics."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from features.geometry import Frame, Intrinsics
from features.perception import Seen
from features.tabletop import TabletopShape
from rtask.interop.episodes.motion import Motion
from simulate.grasping.judgement import Judgement

__all__ = ["ASKED_PLACES", "CAMERA", "Body", "Plan", "Record", "Server", "seen_at"]

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


ASKED_PLACES: list[tuple[float, float]] = []
"""Place of the object that each request in turn is about."""


@dataclass
class Body:
    """A table on which a placed object is gone and a missed one stays."""

    table: list[tuple[float, float]]
    outcomes: list[Record] = field(default_factory=list)
    unreachable: bool = False
    blocked: dict[tuple[float, float], int] = field(default_factory=dict)
    planned: list[Any] = field(default_factory=list)
    executed: list[Any] = field(default_factory=list)
    doubted: tuple[float, ...] = ()
    only_leaning: tuple[float, ...] = ()
    base_frame = "base_footprint"
    ignored = ()
    preset = "faithful"
    takes_poses = False
    other_cameras: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self.pushed: list[Any] = []

    def push(self, points, others, height, side, seed):
        self.pushed.append((points, others))
        return "ok"

    @property
    def gripper_ids(self) -> dict[str, str]:
        return {"right": "right_hand", "left": "left_hand"}

    def look(self, side: str, camera: str | None = None) -> tuple[Frame, np.ndarray]:
        return Frame(np.zeros((12, 16), np.float32), CAMERA), np.eye(4)

    def plan(self, request: Any, obstacles: Any, seed: int) -> Any:
        if self.unreachable or len(self.table) > self.blocked.get((request.x, request.y), 99):
            return "ik"
        if request.theta in self.only_leaning and request.stances == "own":
            return "ik"
        self.planned.append(request)
        return Plan(request, is_doubtful=request.theta in self.doubted)

    def execute(self, plan):
        record = self.outcomes.pop(0) if self.outcomes else Record()
        self.executed.append(plan.request)
        if record.placed:
            self.table.remove((plan.request.x, plan.request.y))
        return record, [("held", b"png")]


class Server:
    """Knows nothing, or everything; keeps what it was told."""

    def __init__(self, knows: float = 0.0, angles: tuple[float, ...] = (0.0,)) -> None:
        self.confidence = knows
        self.angles = angles
        self.asked: list[dict] = []
        self.inserted: list[dict] = []
        self.reported: list[dict] = []
        self.responses: list[tuple[str, str]] = []

    def recognise_for_grasp(self, **request):
        self.asked.append(request)
        known = self.confidence >= 0.7
        x, y = ASKED_PLACES[len(self.asked) - 1] if ASKED_PLACES else (0.0, 0.0)
        grasp = {
            "id": "g:1" if known else "candidate:0",
            "source": "memory" if known else "candidate",
            "x": x,
            "y": y,
            "z": 0.3,
            "theta": 0.0,
            "width": 0.03,
            "opening": 0.05,
            "mean": 0.9,
        }
        match = {"object": "o:7", "label": "can 7", "confidence": self.confidence}
        return {
            "task_id": f"t:{len(self.asked)}",
            "object": "o:7" if known else "",
            "label": "can 7" if known else "",
            "recognition": {
                "accepted": known,
                "matches": [match] if self.confidence else [],
            },
            "grasps": [{**grasp, "theta": angle} for angle in self.angles],
            "times": {"total_s": 0.01},
        }

    def insert_object(self, objects):
        self.inserted.append(objects[0])
        return {"objects": [{"object": objects[0].get("object", f"o:{len(self.inserted)}")}]}

    def report_outcome(self, **report):
        self.reported.append(report)
        return {"stored": 1}

    def report_refusal(self, refusal, response):
        self.responses.append((refusal, response))
        return {"stored": 1}
