"""Decide whether a gripper can hold an object: opening against width, payload against mass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from grasp.spatial.gripper import EndEffector

__all__ = ["Bounds", "Verdict", "can_hold"]

Capability = Literal["proven", "possible", "no"]


@dataclass(frozen=True)
class Bounds:
    """Known bounds on an object's width and mass.

    Parameters
    ----------
    width
        Between the jaws, m; None = unknown.
    mass
        kg; None = unknown.
    mass_bound
        Upper bound, kg: the payload of a hand that has lifted it.
    """

    width: float | None = None
    mass: float | None = None
    mass_bound: float | None = None


@dataclass(frozen=True)
class Verdict:
    """Judgement whether a gripper can hold an object.

    Parameters
    ----------
    capability
        ``proven``: width and mass are known and fit; ``possible``: nothing contradicts it; ``no``.
    code
        ``too_wide``, ``too_narrow``, ``too_heavy``, or what is unknown: ``mass_unknown``,
        ``width_unknown``, ``seal_unknown``; empty when it is proven.
    value, limit
        The value and the limit that it violates, m or kg; None if there is none.
    """

    capability: Capability
    code: str = ""
    value: float | None = None
    limit: float | None = None

    @property
    def text(self) -> str:
        """The verdict in words."""
        texts = {
            "too_wide": "is {0:.0f} mm wide, and the hand opens {1:.0f} mm",
            "too_narrow": "is {0:.0f} mm wide, and the hand holds nothing below {1:.0f} mm",
            "too_heavy": "weighs {0:.0f} g, and the hand lifts {1:.0f} g",
            "mass_unknown": "fits, and nobody knows what it weighs",
            "width_unknown": "has not been measured",
            "seal_unknown": "is light enough, and whether a lip seals on it is not known",
        }.get(self.code, "fits the hand and is light enough")
        if self.value is None or self.limit is None:
            return texts
        return texts.format(1000 * self.value, 1000 * self.limit)


def can_hold(gripper: EndEffector, bounds: Bounds) -> Verdict:
    """Return whether a gripper can hold an object, by the rule that derives ``rt:canGrasp``.

    Examples
    --------
    >>> from grasp.spatial.gripper import ParallelGripper
    >>> hand = ParallelGripper("hand", "nao_hand", min_opening=0.0, max_opening=0.05)
    >>> can_hold(hand, Bounds(0.08, 0.1)).text
    'is 80 mm wide, and the hand opens 50 mm'
    """
    width, mass, payload = bounds.width, bounds.mass, gripper.max_payload
    if gripper.contact_kind == "suction":
        if mass is not None and mass > payload:
            return Verdict("no", "too_heavy", mass, payload)
        return Verdict("possible", "seal_unknown")
    if width is not None and width >= gripper.max_opening:
        return Verdict("no", "too_wide", width, gripper.max_opening)
    if width is not None and width < gripper.min_opening:
        return Verdict("no", "too_narrow", width, gripper.min_opening)
    if mass is not None and mass > payload:
        return Verdict("no", "too_heavy", mass, payload)
    if width is None:
        return Verdict("possible", "width_unknown")
    lightest = [limit for limit in (mass, bounds.mass_bound) if limit is not None]
    if not lightest or min(lightest) > payload:
        return Verdict("possible", "mass_unknown")
    return Verdict("proven")
