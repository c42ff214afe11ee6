"""The world as it will be after a commit that is not made yet, for telling which thing is seen."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rtask.world.identities.identity import Candidate
from rtask.world.identities.seen import Seen
from rtask.world.placement import Placement
from rtask.world.spots import Pose, carried, is_at
from rtask.world.state import WorldState
from rtask.world.uncertainty import MOVED_M, NEARBY_M, Spread, spread_of

__all__ = ["MOVED_RAD", "PendingWorld"]

MOVED_RAD = float(np.deg2rad(15.0))
"""Angle from which a thing has turned, rad."""
_NOWHERE = Spread(0.0, 0.0, 1.0)
_SLIPS_WITHIN_M = 2.0
"""Distance within which a thing slips: an arm may take it at one end of its reach, and lose it at
the other, some 1 m on each side."""


@dataclass
class PendingWorld:
    """Things and their last places, with what a commit changes of them.

    Parameters
    ----------
    world
        The world before the commit.
    """

    world: WorldState
    _last: dict[str, Placement] = field(default_factory=dict, init=False)
    _made: dict[str, list[str]] = field(default_factory=dict, init=False)

    def last(self, exemplar: str) -> Placement | None:
        """Return the last placement of a thing, with what this commit changes."""
        known = self._last.get(exemplar)
        return known if known or self.is_made(exemplar) else self.world.last_placement(exemplar)

    def is_made(self, exemplar: str) -> bool:
        """Whether this commit states a thing for the first time."""
        return any(exemplar in made for made in self._made.values())

    def exemplars(self, product: str) -> list[str]:
        """Return the things of a product, those of this commit last."""
        return [*self.world.exemplars_of(product), *self._made.get(product, ())]

    def candidate(self, exemplar: str, seen: Seen) -> Candidate:
        """Return how a thing of the product compares with the one that is seen."""
        last = self.place_by(exemplar, seen.time_s)
        if last is None:
            return Candidate(exemplar, None, _NOWHERE, is_current=False, is_reachable=False)
        # What this commit changes is not in the index yet, from which the spread counts events.
        pending = exemplar in self._last
        # Before it was first seen, a thing was as unsure as it is so long after.
        time_s = max(seen.time_s, 2.0 * last.begin - seen.time_s)
        is_known = not pending and time_s == seen.time_s
        spread = self.world.spread(last, time_s) if is_known else spread_of(last, time_s)
        there = self._pose_in(last, seen.frame, seen.time_s)
        is_in_place = None
        is_current = last.is_current or seen.time_s < (last.end or seen.time_s)
        if is_current and last.frame_from_subject is None and last.relation in ("on", "in"):
            is_in_place = is_at(self.world, last.place, _pose_of(seen))
            before = self._pose_before(last) if is_in_place is None else None
            if before is not None:
                there = self.world.pose_in(before, seen.frame, seen.time_s)
        has_slipped = last.relation == "held_by" and not is_current
        is_own = last.place.startswith(f"{seen.robot}/") or last.place in seen.hands
        return Candidate(
            exemplar,
            None if there is None else _distance(there[0], seen.frame_from_exemplar),
            spread,
            is_current,
            is_current and last.place in seen.hands,
            there is not None or is_own or self._was_in_reach(last, seen),
            abs(seen.time_s - last.confirmed),
            has_slipped,
            bool(is_in_place),
            has_slipped and not is_own and self._is_beyond_reach(last, seen),
        )

    def _is_beyond_reach(self, last: Placement, seen: Seen) -> bool:
        """Whether one is seen farther from where a thing was taken than what slipped can have come.

        Where nobody knows from where it was taken, it may be anything.
        """
        if self.is_made(last.subject):
            return False
        posed = self.world.last_with_pose(last.subject)
        there = None if posed is None else self.world.pose_in(posed, seen.frame, seen.time_s)
        away_m = 0.0 if there is None else _distance(there[0], seen.frame_from_exemplar)
        return away_m > _SLIPS_WITHIN_M

    def place_by(self, exemplar: str, time_s: float) -> Placement | None:
        """Return the last place of a thing by a time; its first one if it was seen only later."""
        last = self.last(exemplar)
        if last is None or last.begin <= time_s or exemplar in self._last:
            return last
        return self.world.last_placement(exemplar, time_s) or self.world.first_placement(exemplar)

    def _pose_in(
        self, placement: Placement, frame: str, time_s: float
    ) -> tuple[NDArray[np.float64], float] | None:
        """Return the pose in a frame, of a thing that went along with what it is on or in."""
        return self.world.pose_in(carried(self.world, placement, time_s), frame, time_s)

    def _was_in_reach(self, last: Placement, seen: Seen) -> bool:
        """Whether a thing that was in a hand or box last was in the frames of a robot before."""
        if last.frame_from_subject is not None or self.is_made(last.subject):
            return False
        posed = self.world.last_with_pose(last.subject)
        return posed is not None and self.world.pose_in(posed, seen.frame, seen.time_s) is not None

    def is_there(self, last: Placement, seen: Seen) -> bool:
        """Whether a thing is seen where it was, as far as poses tell."""
        there = self._pose_in(last, seen.frame, seen.time_s)
        if there is None:
            return False
        # Between two frames, the error of their transform comes on top of the least move.
        pose, moved_m = there[0], MOVED_M + (0.0 if last.frame == seen.frame else seen.sigma_m)
        if float(np.linalg.norm(pose[:3, 3] - seen.frame_from_exemplar[:3, 3])) > moved_m:
            return False
        # A round thing has no angle about its own axis.
        if seen.is_round:
            cosine = pose[:3, 2] @ seen.frame_from_exemplar[:3, 2]
        else:
            cosine = (np.trace(pose[:3, :3].T @ seen.frame_from_exemplar[:3, :3]) - 1.0) / 2.0
        return bool(np.arccos(np.clip(cosine, -1.0, 1.0)) <= MOVED_RAD)

    def stays(self, last: Placement, seen: Seen) -> bool:
        """Whether a thing that was put on or into something is still there where it is seen now.

        Where the graph does not know where the place is or how large, a look can contradict it only
        by what was seen before: a shove leaves a thing where it is, and a thing that stands where
        it stood when somebody said what it is on has not been taken away.
        """
        if last.relation not in ("on", "in"):
            return False
        is_there = is_at(self.world, last.place, _pose_of(seen))
        if is_there is not None:
            return is_there
        if last.frame_from_subject is None:
            if last.relation == "in":  # things are seen on tables, and seldom in boxes
                return False
            before = self._pose_before(last)
            return bool(seen.exemplar) or (before is not None and self.is_there(before, seen))
        # Put down and nudged, it is still on the same table.
        there = self._pose_in(last, seen.frame, seen.time_s)
        return there is not None and _distance(there[0], seen.frame_from_exemplar) <= NEARBY_M

    def _pose_before(self, last: Placement) -> Placement | None:
        """Return the place with a pose that a thing had when somebody stated what it is on.

        What is in a box now was moved into it.
        """
        if last.relation != "on" or self.is_made(last.subject):
            return None
        for entry in self.world.entries(last.subject):
            if entry.end != last.begin or entry.place >= 0 or entry.frame < 0:
                continue
            placement = self.world.index.read(entry.node)
            if placement is not None and placement.frame_from_subject is not None:
                return replace(last, frame=placement.frame, begin=placement.begin,
                               frame_from_subject=placement.frame_from_subject,
                               sigma_m=placement.sigma_m)  # fmt: skip
        return None

    def pose_at(self, last: Placement | None, place: str, time_s: float) -> Pose | None:
        """Return the pose that a thing has, if that is at a place; in a frame that stays."""
        if last is None or not last.is_current or last.frame_from_subject is None:
            return None
        frame = last.frame
        if self.world.frames.is_of_robot(frame):  # what it measured is where the robot was then
            frame = self.world.frames.rooted(frame, time_s, last.begin).root
        there = self._pose_in(last, frame, time_s)
        if there is None:
            return None
        sigma_m = float(np.hypot(last.sigma_m, np.sqrt(there[1])))
        pose = Pose(frame, there[0], time_s, sigma_m)
        return pose if is_at(self.world, place, pose) else None


def _pose_of(seen: Seen) -> Pose:
    return Pose(seen.frame, seen.frame_from_exemplar, seen.time_s, seen.sigma_m)


def _distance(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(first[:3, 3] - second[:3, 3]))
