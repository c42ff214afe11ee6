"""Weight remembered outcomes and sum them to the counts behind a belief.

The weight of an outcome depends on the object, the gripper, the physics, its age and how far the
robot that reported it is believed; a kernel spreads it to neighbouring grasps. Grasps of other
objects of the same class are transferred by scaling their object's frame to the present object.
"""

from __future__ import annotations

import datetime as dt
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from grasp.learning.bandit import kernel, kernel_in_space
from grasp.spatial.gripper import EndEffector
from rtask.engine.policy import Policy
from rtask.engine.remembered import Memory, Remembered, Tally

__all__ = ["Evidence", "Weights", "gather", "without_trials", "won_by"]

_MIN_SHARE = 0.05
"""Objects that contribute less evidence than this are not named as its sources."""


@dataclass(frozen=True)
class Evidence:
    """Weighted successes and failures for each arm.

    Parameters
    ----------
    successes, failures : (n,)
    objects
        For each arm, IRIs of the objects that contribute evidence, by decreasing weight.
    """

    successes: NDArray[np.float64]
    failures: NDArray[np.float64]
    objects: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Weights:
    """Weight of one remembered outcome.

    Parameters
    ----------
    confidence
        Confidence that each object is the present one, by IRI.
    gripper
        Gripper of the asking robot.
    size
        (length, width, height) of the present object, m.
    now
        Current time, from which ages are computed.
    forces
        Largest closing force, N, by type of gripper, where it is known.
    is_fast
        Whether the asking robot is simulated with the coarse physics preset.
    """

    policy: Policy
    confidence: Mapping[str, float]
    gripper: EndEffector
    size: tuple[float, float, float]
    now: dt.datetime
    forces: Mapping[str, float] = field(default_factory=dict)
    is_fast: bool = False

    def of(self, grasp: Remembered, tally: Tally) -> float:
        """Return the weight of one attempt in a tally."""
        # Another object of the class may differ in why it failed, so its failures weigh 1.
        rule = tally.held or grasp.of_class
        return self.policy.weight_of(rule, discounted=False) * self.trust(grasp, tally)

    def trust(self, grasp: Remembered, tally: Tally) -> float:
        """Return how far one attempt in a tally is true of the present object and hand, 0..1."""
        weight = tally.weight * self.policy.weight_of(True, tally.is_fast and not self.is_fast)
        weight *= self._object(grasp) * self._gripper(grasp, tally.held)
        half_life = self.policy.half_life_days
        if half_life is not None and tally.latest is not None:
            age_days = max((self.now - tally.latest).total_seconds() / 86_400, 0.0)
            weight *= 0.5 ** (age_days / half_life)
        return weight

    def _object(self, grasp: Remembered) -> float:
        if not grasp.of_class:
            return self.confidence.get(grasp.object, 0.0)
        if grasp.size is None:
            return 0.0
        distance = np.linalg.norm(np.log(np.array(grasp.size) / np.array(self.size)))
        fade = np.exp(-(distance**2) / (2 * self.policy.size_bandwidth**2))
        return self.policy.same_class * float(fade)

    def _gripper(self, grasp: Remembered, held: bool) -> float:
        """Return the weight of an outcome by the hand that had it.

        What a weak hand holds a strong one holds, and what a strong hand drops a weak one drops;
        the other way round, little follows; and nothing from contacts of another kind.
        """
        mine, theirs = self.gripper.gripper_type, grasp.gripper_type
        if grasp.contact_kind != self.gripper.contact_kind:
            return 0.0
        if theirs == mine:
            return 1.0
        if not self.gripper.min_opening <= min(self.size[:2]) <= self.gripper.max_opening:
            return 0.0
        if mine not in self.forces or theirs not in self.forces:
            return self.policy.other_gripper
        asks, tells = self.forces[mine], self.forces[theirs]
        follows = tells <= asks if held else tells >= asks
        return 1.0 if follows else self.policy.doubtful_transfer


def without_trials(memory: Memory) -> tuple[Remembered, ...]:
    """Return the remembered grasps without the attempts of the current episode.

    The learner adds these itself, with more weight on failures; they must not be counted twice.
    """
    mine = Counter((t.grasp, t.held, t.lost, t.is_fast) for t in memory.trials)
    cleaned = []
    for grasp in memory.grasps:
        if grasp.of_class:
            cleaned.append(grasp)
            continue
        tallies = []
        for tally in grasp.tallies:
            if tally.robot:
                tallies.append(tally)
                continue
            kind = grasp.grasp, tally.held, tally.lost, tally.is_fast
            taken = min(mine[kind], tally.count)
            mine[kind] -= taken
            if tally.count > taken:
                tallies.append(replace(tally, count=tally.count - taken))
        cleaned.append(replace(grasp, tallies=tuple(tallies)))
    return tuple(cleaned)


def gather(
    positions: NDArray[np.float64],
    thetas: NDArray[np.float64],
    remembered: Sequence[Remembered],
    weights: Weights,
    bandwidth: float,
    axes: NDArray[np.float64] | None = None,
) -> Evidence:
    """Return the graph's evidence on each arm.

    Parameters
    ----------
    positions : (n, 3), m, frame of the present object
    thetas : (n,), rad, frame of the present object
    remembered
        Remembered grasps without the current episode; see :func:`without_trials`.
    axes : (n, 2, 3) or None
        Closing and approach direction of each arm; None if all are from above.
    """
    tried = [g for g in remembered if g.tallies]
    n = len(positions)
    if not tried or n == 0:
        return Evidence(np.zeros(n), np.zeros(n), ((),) * n)
    there = np.array([_scaled(g, weights.size) for g in tried])
    angles = np.array([g.theta for g in tried])
    size = max(weights.size)
    if axes is None:
        near = kernel(positions, thetas, there, angles, size, bandwidth)
    else:
        # Cups and three fingers are alike about their approach.
        turns = np.stack(
            [g.object_from_gripper[:3, [0 if g.contacts is None else 2, 2]].T for g in tried]
        )
        near = kernel_in_space(positions, axes, there, turns, size, bandwidth)
    won = np.array([_weight(g, weights, held=True) for g in tried])
    lost = np.array([_weight(g, weights, held=False) for g in tried])
    # Rounded, so that the order of the rows does not affect the last bit.
    successes, failures = np.round(near @ won, 9), np.round(near @ lost, 9)
    return Evidence(successes, failures, _sources(near * (won + lost), tried))


def won_by(remembered: Sequence[Remembered], weights: Weights) -> dict[str, float]:
    """Return the weighted successes of each grasp of the object itself, by IRI."""
    return {g.grasp: _weight(g, weights, held=True) for g in remembered if not g.of_class}


def _weight(grasp: Remembered, weights: Weights, held: bool) -> float:
    return sum(weights.of(grasp, t) * t.count for t in grasp.tallies if t.held is held)


def _scaled(grasp: Remembered, size: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the grasp's position scaled to an object of another size."""
    if not grasp.of_class or grasp.size is None:
        return grasp.x, grasp.y, grasp.z
    x, y, z = (
        at * here / there
        for at, here, there in zip((grasp.x, grasp.y, grasp.z), size, grasp.size, strict=True)
    )
    return x, y, z


def _sources(
    shares: NDArray[np.float64], grasps: Sequence[Remembered]
) -> tuple[tuple[str, ...], ...]:
    """Return for each row of shares the objects that have a part of it, the largest first."""
    sources = []
    for row in shares:
        by_object: dict[str, float] = {}
        for share, grasp in zip(row, grasps, strict=True):
            by_object[grasp.object] = by_object.get(grasp.object, 0.0) + round(float(share), 6)
        heavy = sorted((-w, iri) for iri, w in by_object.items() if w >= _MIN_SHARE)
        sources.append(tuple(iri for _, iri in heavy))
    return tuple(sources)
