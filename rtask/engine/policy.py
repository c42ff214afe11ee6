"""Thresholds and weights of decisions."""

from __future__ import annotations

from dataclasses import dataclass, field
from hashlib import sha256

from grasp.learning.bandit import Policy as Bandit
from rtask.rdf.namespaces import reason

__all__ = ["JUDGED", "LOST", "LOST_CODE", "UNJUDGED", "Policy"]

_SCHEME = 1
UNJUDGED = (
    "timed_out", "stopped_by_human", "hardware",
    "no_match", "low_recognition", "wrong_object", "pose_unknown", "low_pose",
    "no_grasp", "low_grasp",
    "ik", "tilt", "grasp_collision", "approach_ik", "approach_collision", "pregrasp_collision",
    "lift_ik", "rrt_start", "rrt_goal", "rrt_time", "tracking",
)  # fmt: skip
"""Reasons that concern the robot or the situation, not the grasp.

Such attempts are stored like all others but not counted: that an arm could not reach an object
says nothing about grasping it elsewhere."""

JUDGED = f"""?attempt rt:executesGrasp ?grasp ; prov:endedAtTime ?ended ; rt:hasOutcome ?outcome .
    ?outcome rt:hasReason ?reason ; rt:success ?decided
    BIND(IF(?decided, !EXISTS {{ ?outcome rt:judgedSuccess false }},
      EXISTS {{ ?outcome rt:judgedSuccess true }}) AS ?held)
    FILTER(?held != ?decided || ?reason NOT IN ({", ".join(map(str, map(reason, UNJUDGED)))}))
    FILTER NOT EXISTS {{ ?outcome rt:disputed true }}"""
"""Pattern of a judged attempt of ``?grasp``: verdicts of people override the report, and disputed
attempts are left out."""

LOST_CODE = "slip_transport"
"""Reason of an object that was held and then lost on the way."""

# Where a carton was held that a NAO then lost says next to nothing of its ends (3 of 7 at the firm
# one). As a failure like any other, a loss made later robots reach for the end that gives way.
LOST = f"BIND(?held = false && ?reason = {reason(LOST_CODE)} AS ?lost)"
"""Pattern after :data:`JUDGED`: whether the attempt held its object and lost it on the way."""


@dataclass(frozen=True)
class Policy:
    """Parameters of the engine's decisions.

    Parameters
    ----------
    bandit
        Formation of beliefs from geometry and evidence.
    same_class
        Weight of outcomes of other objects of the class; 1 = as for the object itself.
    size_bandwidth
        Bandwidth of such evidence in the logarithm of the size.
    size_tolerance
        Largest factor between the sizes of objects that provide such evidence.
    other_gripper
        Weight of outcomes of another gripper type, if the width fits and the force of either is
        unknown.
    doubtful_transfer
        Weight of a success of a stronger gripper of another type, and of a failure of a weaker
        one; a success of a weaker one and a failure of a stronger one count in full.
    fast_physics
        Weight of outcomes from the coarse physics preset for robots elsewhere.
    causes
        Whether attempts speak about hidden causes; see :mod:`grasp.learning.causes`.
    half_life_days
        Half-life of evidence; None = unlimited.
    size_gate, size_gate_m
        Largest factor and difference (m) between a measured extent and that of a similar object.
    inliers_when_alone
        Number of inliers that identify an object if it is the only one in the graph.
    suggestion
        Largest confidence of such a match otherwise.
    same_pose_m, same_pose_rad
        Distance and angle within which two grasps of an object are the same.
    min_identity, min_pose, min_grasp
        c_I, c_T and c_G of Kehoe 2014, 4.3, for requests for a decision without thresholds.
    clock_ahead_s
        How far the clock of a robot may be ahead of that of this machine; beyond it, the time of
        receipt is stored.
    """

    bandit: Bandit = field(default_factory=Bandit)
    same_class: float = 0.7
    size_bandwidth: float = 0.3
    size_tolerance: float = 1.5
    other_gripper: float = 0.5
    doubtful_transfer: float = 0.3
    fast_physics: float = 0.3
    causes: bool = True
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
    clock_ahead_s: float = 300.0

    @property
    def version(self) -> str:
        """Version of the rules for beliefs, which changes with their parameters.

        >>> Policy().version == Policy(min_grasp=0.5).version != Policy(fast_physics=0.5).version
        True
        >>> Policy().version == Policy(bandit=Bandit(rho=1.0)).version
        False
        """
        bandit = self.bandit
        numbers = (bandit.kappa, bandit.cap, bandit.floor, bandit.rho, self.fast_physics)
        return f"beta-{_SCHEME}-{sha256(repr(numbers).encode()).hexdigest()[:8]}"

    def weight_of(self, held: bool, discounted: bool) -> float:
        """Return the weight of one attempt at the object itself, with the hand that asks.

        Parameters
        ----------
        held
            A failure weighs rho: an object that does not change fails the same way again.
        discounted
            Whether it was made in coarse physics and is weighed for a robot elsewhere.

        Examples
        --------
        >>> Policy().weight_of(True, False), Policy().weight_of(False, False)
        (1.0, 2.0)
        """
        return (1.0 if held else self.bandit.rho) * (self.fast_physics if discounted else 1.0)
