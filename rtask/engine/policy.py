"""Thresholds and weights of a decision, in one place."""

from __future__ import annotations

from dataclasses import dataclass, field
from hashlib import sha256

from grasp.learning.bandit import Policy as Bandit

__all__ = ["Policy"]

_SCHEME = 1


@dataclass(frozen=True)
class Policy:
    """Parameters of the engine's decisions.

    Parameters
    ----------
    bandit
        How beliefs are formed from geometry and evidence.
    same_class
        Weight of what happened with other objects of the class, 1 = as on the object itself.
    size_bandwidth
        Difference of the logarithms of the sizes at which such evidence fades.
    size_tolerance
        Objects of the class whose sizes differ by a larger factor are not asked about.
    other_gripper
        Weight of what another kind of gripper did, where the width fits.
    fast_physics
        Weight of outcomes from the coarse physics preset.
    half_life_days
        After which evidence counts half; None = it never fades.
    size_gate, size_gate_m
        Factor and m by which a measured extent may differ from the object's that it looks like.
    inliers_when_alone
        Agreeing features that identify an object while the graph knows no other to compare with.
    suggestion
        Confidence that such a look-alike keeps at most.
    same_pose_m, same_pose_rad
        Grasps closer than this on one object are one grasp.
    min_identity, min_pose, min_grasp
        c_I, c_T and c_G of Kehoe 2014, 4.3, for requests that ask for a decision and name none.
    """

    bandit: Bandit = field(default_factory=Bandit)
    same_class: float = 0.7
    size_bandwidth: float = 0.3
    size_tolerance: float = 1.5
    other_gripper: float = 0.5
    fast_physics: float = 0.3
    half_life_days: float | None = None
    size_gate: float = 1.3
    size_gate_m: float = 0.006
    inliers_when_alone: int = 10
    suggestion: float = 0.5
    same_pose_m: float = 0.003
    same_pose_rad: float = 0.09
    min_identity: float = 0.7
    min_pose: float = 0.7
    min_grasp: float = 0.3

    @property
    def version(self) -> str:
        """Version of the rules that turn outcomes into a belief; it changes with their numbers.

        >>> Policy().version == Policy(min_grasp=0.5).version != Policy(fast_physics=0.5).version
        True
        """
        bandit = self.bandit
        numbers = (bandit.kappa, bandit.cap, bandit.floor, self.fast_physics)
        return f"beta-{_SCHEME}-{sha256(repr(numbers).encode()).hexdigest()[:8]}"

    def weight_of(self, is_fast: bool) -> float:
        """Return the weight of an outcome by the physics preset in which it happened."""
        return self.fast_physics if is_fast else 1.0
