"""A lab in which a believed cause is real: what a robot meets there if the graph is right."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace

import numpy as np

from rtask.tasks.diagnosis.attempt import Failure, Hand, Try
from rtask.tasks.diagnosis.hypotheses import Hypothesis
from simulate.tasks.body import Attempted, Deed
from simulate.tasks.lab import LabRobot
from simulate.tasks.trials.physics import (
    IN_PHYSICS,
    draw_object,
    draw_weakness,
    grasp_holds,
    gripper_of,
)
from simulate.world.objects import ObjectSpec
from simulate.world.seeds import stream
from simulate.world.world import World

__all__ = ["BelievedCause", "BelievedRobot", "Hidden", "draw_causes"]

_STREAM = 75
_REDRAWS = 6
"""Draws after which a failure is taken not to be reproducible in physics."""
_MOVED = frozenset(("stale_place", "dropped"))
"""Causes under which the thing is elsewhere: a look shows it, and nothing else helps."""


@dataclass(frozen=True)
class BelievedCause:
    """One draw of what was wrong.

    Parameters
    ----------
    hypothesis
        The cause.
    luck
        0..1; a grasp that no physics decides holds where the cause leaves more than that.
    thing, weakness
        What hides in the thing, and the share of its force that the hand which failed has left.
    noise
        Seed of how far beside its aim a hand closes.
    """

    hypothesis: Hypothesis
    luck: float
    thing: ObjectSpec | None
    weakness: float
    noise: int

    @property
    def is_moved(self) -> bool:
        """Whether the thing is not where it was believed to be."""
        return self.hypothesis.kind in _MOVED


@dataclass
class Hidden:
    """What happens to the hand that takes the thing, under each cause.

    Parameters
    ----------
    failure
        What failed.
    hands
        All hands, by their IRIs.
    """

    failure: Failure
    hands: Mapping[str, Hand]
    _stack: ExitStack = field(default_factory=ExitStack)
    _world: World | None = None

    def __enter__(self) -> Hidden:
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def holds(self, cause: BelievedCause, tried: Try) -> tuple[bool, bool]:
        """Return whether a grasp holds under a cause, and whether physics decided that."""
        thing = cause.thing
        if thing is None or tried.along is None or gripper_of(tried.hand) is None:
            return cause.luck < cause.hypothesis.share(tried), False
        rng = np.random.default_rng(cause.noise)
        world = self._physics()
        return grasp_holds(world, thing, self.failure, tried, cause.weakness, rng), True

    def _physics(self) -> World:
        # One world for all tries: each grasp has a new copy of the thing.
        if self._world is None:
            self._world = self._stack.enter_context(World("fast"))
            self._world.add_table()
        return self._world


def draw_causes(
    hidden: Hidden, beliefs: Sequence[tuple[Hypothesis, float]], tries: int, seed: int
) -> list[BelievedCause]:
    """Return draws of the cause under which the failed grasp fails as it did.

    Causes are drawn systematically, so that a few draws have the shares that are believed. What a
    cause hides is drawn anew until the grasp fails, since a draw in which it holds is not what
    happened; where physics never shows the failure, the belief decides instead.
    """
    chances = np.cumsum([chance for _, chance in beliefs])
    start = float(stream(seed, _STREAM).random())
    causes = []
    for number in range(tries):
        rng = stream(seed, _STREAM, number)
        part = (number + start) / tries * chances[-1]
        hypothesis = beliefs[min(int(np.searchsorted(chances, part)), len(beliefs) - 1)][0]
        causes.append(_draw(hidden, hypothesis, rng))
    return causes


def _draw(hidden: Hidden, hypothesis: Hypothesis, rng: np.random.Generator) -> BelievedCause:
    failure = hidden.failure
    left = hypothesis.share(failure.tried)
    luck = float(left + (1 - left) * rng.random())
    noise = int(rng.integers(2**31))
    if hypothesis.kind in IN_PHYSICS and failure.length and failure.width:
        for _ in range(_REDRAWS):
            thing = draw_object(failure, hypothesis, rng)
            noise = int(rng.integers(2**31))
            cause = BelievedCause(hypothesis, luck, thing, draw_weakness(hypothesis, rng), noise)
            holds, is_physical = hidden.holds(cause, failure.tried)
            if is_physical and not holds:
                return cause
            if not is_physical:
                break
    return BelievedCause(hypothesis, luck, None, 1.0, noise)


@dataclass(frozen=True)
class BelievedRobot(LabRobot):
    """A robot of a lab, whose hands meet the believed cause.

    Parameters
    ----------
    hidden, cause
        What happens to a hand that takes the thing.
    along
        Where along it hands take it, m from the middle; None where not known.
    grasp
        IRI of the grasp; empty for any.
    in_physics
        Added to for each grasp that physics decided.
    """

    hidden: Hidden
    cause: BelievedCause
    along: float | None
    grasp: str
    in_physics: list[bool]

    def pick(self, item: str, place: str, hand: str) -> Deed:
        """Pick a thing up, unless the cause prevents it."""
        deed = super().pick(item, place, hand)
        return self._unless_caused(deed, item, place, hand) if deed.success else deed

    def put(self, item: str, place: str, hand: str) -> Deed:
        """Put a thing down, unless it was in the hand already when it failed."""
        deed = super().put(item, place, hand)
        was_held = hand == self.hidden.failure.origin and not self.in_physics
        return self._unless_caused(deed, item, hand, hand) if was_held and deed.success else deed

    def _unless_caused(self, deed: Deed, item: str, before: str, hand: str) -> Deed:
        """Return what came of taking a thing; it is back where it was if the cause prevents it."""
        failure = self.hidden.failure
        if item != failure.tried.thing:
            return deed
        tried = replace(
            failure.tried, hand=self.hidden.hands.get(hand, Hand(hand, self.iri)),
            place=before, along=self.along, grasp=self.grasp, held=False,
            done_before=self._done_before(item, before),
        )  # fmt: skip
        holds, is_physics = self.hidden.holds(self.cause, tried)
        self.in_physics.append(is_physics)
        reason = "ok" if holds else failure.tried.reason or "slip_lift"
        if not holds:
            self.lab.where[item] = before
            self.lab.done.pop()
        lifted_m = deed.lifted_m if holds else 0.0
        return Deed(holds, reason, deed.duration_s, lifted_m, self._report(holds, reason))

    def _report(self, holds: bool, reason: str) -> Attempted | None:
        """Return the grasp with its place on the thing, so that the branch learns where it held."""
        if self.along is None:
            return None
        pose = {"x": self.along, "y": 0.0, "z": 0.0, "theta": 0.0}
        outcome = {"success": holds, "reason": reason, "preset": self.physics}
        return Attempted({"id": "", "in_object": pose}, outcome)

    def _done_before(self, item: str, place: str) -> frozenset[str]:
        """Return what of the occasion is as it should be, which shows in the lab by itself."""
        if self.cause.is_moved:
            return frozenset({"looked"})  # elsewhere it would not have been seen, nor taken
        beside = [other for other, at in self.lab.where.items() if at == place and other != item]
        is_clear = bool(self.hidden.failure.neighbours) and not beside
        return frozenset({"cleared"}) if is_clear else frozenset()
