"""Choose a grasp: what is remembered and what geometry proposes, in the learner's order."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasp.learning.bandit import Arm, BetaThompson, Choice
from grasp.learning.bandit import Trial as Tried
from grasp.spatial.footprint import Footprint
from grasp.spatial.frames import angle_between_axes, wrap_axis
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.planar import PlanarGrasp, propose_planar, rate
from rtask.engine.experience import Weights, gather, without_trials
from rtask.engine.placement import Placement
from rtask.engine.policy import Policy
from rtask.engine.recall import Memory, Remembered

__all__ = ["Option", "Scene", "choose", "options"]

_MERGE_M = 0.005
_MERGE_RAD = np.deg2rad(10)


@dataclass(frozen=True)
class Scene:
    """What a choice depends on besides memory.

    Parameters
    ----------
    footprint
        Of the object, in the robot's frame.
    placement
        Of the object, in the robot's frame.
    neighbours : (m, 3) or None, m
        x, y in the robot's frame, z over the support.
    """

    footprint: Footprint
    placement: Placement
    gripper: ParallelGripper
    neighbours: NDArray[np.float64] | None = None
    seed: int = 0

    @property
    def size(self) -> tuple[float, float, float]:
        """(length, width, height), m."""
        return self.footprint.length, self.footprint.width, self.footprint.height


@dataclass(frozen=True)
class Option:
    """A grasp that may be chosen.

    Parameters
    ----------
    id
        IRI of a remembered grasp, ``candidate:<k>`` of a proposed one.
    grasp
        In the robot's frame, z over the support.
    in_object
        (x, y, z, theta) in the object's frame.
    remembered
        What the graph knows about this very grasp.
    choice
        The learner's view; filled in by :func:`choose`.
    sources
        Objects whose outcomes speak about it.
    """

    id: str
    grasp: PlanarGrasp
    in_object: tuple[float, float, float, float]
    remembered: Remembered | None = None
    choice: Choice | None = None
    sources: tuple[str, ...] = ()

    @property
    def explanation(self) -> dict[str, Any]:
        """Why it stands where it stands: parts of the belief, and a sentence."""
        if self.choice is None:
            return {}
        parts = dict(self.choice.explanation)
        parts["objects"] = list(self.sources)
        parts["text"] = _sentence(self, parts)
        return parts


def options(
    scene: Scene, memory: Memory, object_iri: str | None, propose: bool, limit: int = 50
) -> list[Option]:
    """Return the grasps to choose from: those of the object, then new candidates beside them.

    Parameters
    ----------
    object_iri
        The object, when it is known which one it is.
    propose
        Whether geometry may add candidates.
    limit
        Of the candidates.
    """
    found: list[Option] = []
    for known in memory.of(object_iri) if object_iri else []:
        x, y, theta = scene.placement.to_frame(known.x, known.y, known.theta)
        draft = PlanarGrasp(
            x, y, known.z, wrap_axis(theta), 0.0, known.opening, 0.0, "memory", scene.seed
        )
        rated = rate(scene.footprint, scene.gripper, draft, scene.neighbours)
        if rated is not None and rated.clearance > 0:
            at = (known.x, known.y, known.z, known.theta)
            found.append(Option(known.grasp, rated, at, known))
    if not propose:
        return found
    proposed = propose_planar(
        scene.footprint, scene.gripper, scene.neighbours, scene.seed, max_candidates=limit
    )
    for k, grasp in enumerate(proposed):
        if not any(_same(grasp, other.grasp, _MERGE_M, _MERGE_RAD) for other in found[:200]
                   if other.remembered is not None):  # fmt: skip
            x, y, theta = scene.placement.to_object(grasp.x, grasp.y, grasp.theta)
            # As the graph will keep it, so that it weighs the same before and after.
            x, y, z, theta = (round(v, 6) + 0.0 for v in (x, y, grasp.z, wrap_axis(theta)))
            found.append(Option(f"candidate:{k}", grasp, (x, y, z, theta)))
    return found


def choose(
    candidates: Sequence[Option],
    scene: Scene,
    memory: Memory,
    confidence: Mapping[str, float],
    policy: Policy,
    now: dt.datetime | None = None,
) -> list[Option]:
    """Return the options in the order in which to try them; empty when none is worth it.

    Parameters
    ----------
    confidence
        That each object of the memory is the one in question, by IRI.
    """
    if not candidates:
        return []
    at = np.array([option.in_object for option in candidates])
    weights = Weights(policy, confidence, scene.gripper, scene.size, now or dt.datetime.now(dt.UTC))
    evidence = gather(at[:, :3], at[:, 3], without_trials(memory), weights, policy.bandit.bandwidth)
    arms = [
        Arm(
            (float(x), float(y), float(z)), float(theta), option.grasp.quality,
            float(evidence.successes[i]), float(evidence.failures[i]), option.grasp.opening,
        )
        for i, (option, (x, y, z, theta)) in enumerate(zip(candidates, at, strict=True))
    ]  # fmt: skip
    trials = [Tried((t.x, t.y, t.z), t.theta, t.held) for t in memory.trials]
    learner = BetaThompson(policy.bandit, max(scene.size))
    return [
        replace(candidates[c.index], choice=c, sources=evidence.objects[c.index])
        for c in learner.rank(arms, trials, scene.seed)
    ]


def _same(a: PlanarGrasp, b: PlanarGrasp, metres: float, radians: float) -> bool:
    near = np.hypot(a.x - b.x, a.y - b.y) <= metres and abs(a.z - b.z) <= metres
    return bool(near and angle_between_axes(a.theta, b.theta) <= radians)


def _sentence(option: Option, parts: Mapping[str, Any]) -> str:
    """Return the explanation in words."""
    assert option.choice is not None
    won, lost = parts["graph"]
    said = [f"geometry rates it {parts['quality']:.2f}"]
    if option.remembered is not None and option.remembered.attempts:
        known = option.remembered
        said.append(f"it held {known.successes} of {known.attempts} times")
    if max(won, lost) >= 0.05:
        where = f" on {len(option.sources)} object(s)" if option.sources else ""
        said.append(f"this and similar grasps{where} count {won:.1f} held, {lost:.1f} lost")
    if max(parts["episode"]) >= 0.05:
        said.append(f"tries just now add {parts['episode'][0]:.1f} and {parts['episode'][1]:.1f}")
    low, high = option.choice.interval90
    chance = f"chance {option.choice.mean:.2f} ({low:.2f} to {high:.2f})"
    how = {"proven": "proven, so it goes first", "sample": "drawn among the best",
           "mean": "in order of chance"}[parts["selected_by"]]  # fmt: skip
    return f"{chance}: {'; '.join(said)}; {how}"
