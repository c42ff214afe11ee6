"""A proposed change tried in physics: a hand without an arm takes a thing that fails as believed.

What hides in a thing is not known, or it would not have failed. So each try draws what is wrong
from the causes that the graph believes in: the outcome says whether the change would hold *if* one
of these is the cause. The grasp that failed is tried under the same draws, since a simulation in
which that one holds as well has not reproduced the failure, and says nothing about a change.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from grasp.spatial.gripper_files import gripper_named
from rtask.tasks.diagnosis import Diagnosis, beliefs_of
from rtask.tasks.diagnosis.attempt import Failure, Hand
from simulate.tasks.trials.physics import (
    IN_PHYSICS,
    MASS_KG,
    draw_object,
    draw_weakness,
    grasp_holds,
    gripper_of,
)
from simulate.world.seeds import stream
from simulate.world.world import World

__all__ = ["MAX_TRIES", "FailureTrial", "try_change"]

MAX_TRIES = 50
_CPU_S = 60.0
"""Processor time after which no further try begins."""
_STREAM = 74
_CHANGES = ("grasp", "hand")


@dataclass(frozen=True)
class FailureTrial:
    """What came of a change in physics.

    Parameters
    ----------
    tries
        Pairs of grasps that were carried out: the one that failed, and the change.
    failed_held, held
        How many of each held.
    believed
        Chance of the causes that were simulated, 0..1.
    assumed
        What the graph does not say, in words.
    refusal
        Why nothing was tried; empty if it was.
    """

    tries: int = 0
    failed_held: int = 0
    held: int = 0
    believed: float = 0.0
    assumed: tuple[str, ...] = ()
    refusal: str = ""

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the share of tries in which the change held (Wilson 1927)."""
        if not self.tries:
            return 0.0, 1.0
        interval = stats.binomtest(self.held, self.tries).proportion_ci(0.95, method="wilson")
        return float(interval.low), float(interval.high)

    @property
    def reproduces(self) -> bool:
        """Whether the grasp that failed fails in most tries as well."""
        return self.tries > 0 and 2 * self.failed_held < self.tries

    @property
    def agrees(self) -> bool:
        """Whether the failure is reproduced and the change holds in most tries."""
        return self.reproduces and 2 * self.held > self.tries

    @property
    def text(self) -> str:
        """All of it in words."""
        if self.refusal:
            return f"not tried: {self.refusal}; nothing was stored"
        low, high = self.interval
        lines = [
            f"tried in simulation: held {self.held} of {self.tries} ({low:.2f} to {high:.2f}); "
            f"what failed held {self.failed_held} of {self.tries}; nothing was stored",
            f"  if it is one of the causes that were simulated (chance {self.believed:.2f})",
        ]
        if not self.reproduces:
            lines.append("  the failure is not reproduced, so that this says nothing of the change")
        return "\n".join([*lines, *(f"  assumed: {each}" for each in self.assumed)])

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-able values."""
        return {
            "tries": self.tries, "failed_held": self.failed_held, "held": self.held,
            "interval": [round(end, 4) for end in self.interval],
            "believed": round(self.believed, 4), "reproduces": self.reproduces,
            "agrees": self.agrees, "assumed": list(self.assumed), "refusal": self.refusal,
            "text": self.text,
        }  # fmt: skip


def try_change(diagnosis: Diagnosis, tries: int = 5, seed: int = 0) -> FailureTrial:
    """Try the change of a diagnosis in physics, beside the grasp that failed.

    Only what a hand and a thing alone decide is tried: another grasp or another hand, where the
    likeliest cause lies in either. Nothing is read from a graph, or written to one.

    Parameters
    ----------
    tries
        How often, 1 to 50; fewer are made once 60 s of processor time are over.
    seed
        Of what is drawn: the cause of each try, and how far beside its aim the hand closes.
    """
    beliefs = [
        belief for belief in beliefs_of(diagnosis.failure) if belief[0].kind in IN_PHYSICS
    ] if diagnosis.change is not None else []  # fmt: skip
    refusal = _refusal(diagnosis)
    if refusal or diagnosis.change is None:
        return FailureTrial(refusal=refusal)
    failure, changed = diagnosis.failure, diagnosis.change.tried
    chances = np.array([chance for _, chance in beliefs])
    rng, began = stream(seed, _STREAM), time.process_time()
    done, failed_held, held = 0, 0, 0
    with World("fast") as world:
        world.add_table()
        while done < min(tries, MAX_TRIES) and time.process_time() - began < _CPU_S:
            cause = beliefs[int(rng.choice(len(beliefs), p=chances / chances.sum()))][0]
            # Both grasps meet the same draw, so that only the change differs between them.
            thing, weakness = draw_object(failure, cause, rng), draw_weakness(cause, rng)
            failed_held += grasp_holds(world, thing, failure, failure.tried, weakness, rng)
            held += grasp_holds(world, thing, failure, changed, weakness, rng)
            done += 1
    assumed = _assumed(failure, (failure.tried.hand, changed.hand))
    return FailureTrial(done, failed_held, held, float(chances.sum()), assumed)


def _refusal(diagnosis: Diagnosis) -> str:
    """Return why a change cannot be tried; empty if it can."""
    failure, change = diagnosis.failure, diagnosis.change
    if failure.held:
        return "nothing failed"
    if change is None:
        return "no change is known that would have mended it"
    first = diagnosis.causes[0]
    if first.kind not in IN_PHYSICS:
        return f"the likeliest cause ({first.text}) is not one that a hand and a thing alone show"
    if change.kind not in _CHANGES:
        return f"the change ({change.kind}) is neither another grasp nor another hand"
    for value, what in (
        (failure.length, "length"), (failure.width, "width"),
        (failure.tried.along, "place of the grasp that failed"),
        (change.tried.along, "place of the other grasp"),
    ):  # fmt: skip
        if value is None:
            return f"the graph does not say the {what}"
    for hand in (failure.tried.hand, change.tried.hand):
        if gripper_of(hand) is None:
            return f"the graph says neither a known type nor the opening of {hand.iri or 'a hand'}"
    return ""


def _assumed(failure: Failure, hands: Sequence[Hand]) -> tuple[str, ...]:
    lines = ["it is a box as high as it is wide, and the jaws close across its width"]
    if failure.mass is None:
        lines.append(f"it weighs {MASS_KG} kg")
    for hand in dict.fromkeys(hands):
        try:
            gripper_named(hand.kind.removesuffix("_hand"))
        except (ValueError, OSError):
            lines.append(f"the hand of {hand.name} is two plain jaws of its opening")
    return tuple(lines)
