"""A grasp candidate in space and what is known about it (Kehoe 2014, 4.4; Gatto 2016, 3.3.3)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

__all__ = ["Antipodal", "GraspCandidate", "Proposals", "Source"]

Source = Literal["mesh", "cloud", "planar", "recalled"]
Antipodal = Literal["full", "half", "none"]


@dataclass(frozen=True)
class GraspCandidate:
    """One way to close a gripper on an object.

    Parameters
    ----------
    frame_from_gripper : (4, 4)
        Pose in the frame of the cloud or mesh that it was found on. Gripper frame: z = approach,
        x = closing direction, origin midway between the fingertips' pads.
    width
        Distance between the contacts, m.
    depth
        How far the fingertips reach past the first surface along the approach, m.
    contacts, normals : (2, 3) or None, m
        Where the jaws touch and the normals there, **out of** the object; row 0 is touched by the
        jaw at -x.
    source
        What the candidate was found on.
    antipodal
        Whether the surface opposes both jaws, one, or none (ten Pas and Platt 2015).
    completed
        Whether the far side was completed by symmetry rather than seen.
    opening : None or m
        Distance between the jaws before closing, where it was checked for collisions.
    scores
        By name: ``confidence``, ``lower_95``, ``epsilon``, ``classifier``, ``clearance`` (m).
    features : (14,) or None
        What a learner sees, dimensionless.
    """

    frame_from_gripper: NDArray[np.float64]
    width: float
    depth: float = 0.0
    contacts: NDArray[np.float64] | None = None
    normals: NDArray[np.float64] | None = None
    source: Source = "mesh"
    antipodal: Antipodal = "none"
    completed: bool = False
    opening: float | None = None
    scores: Mapping[str, float] = field(default_factory=dict)
    features: NDArray[np.float64] | None = None

    @property
    def centre(self) -> NDArray[np.float64]:
        """Tool centre point (3,), m."""
        return self.frame_from_gripper[:3, 3]

    @property
    def closing(self) -> NDArray[np.float64]:
        """Unit vector from the jaw at -x to the jaw at +x (3,)."""
        return self.frame_from_gripper[:3, 0]

    @property
    def approach(self) -> NDArray[np.float64]:
        """Unit vector along which the gripper comes (3,)."""
        return self.frame_from_gripper[:3, 2]


@dataclass(frozen=True)
class Proposals:
    """Candidates and, where there are none, why; behaves like a list.

    Parameters
    ----------
    candidates
        Best first where they are ranked.
    reason
        Why the list is empty; "" when it is not.
    notes
        What was done to the input, for people.
    counts
        How many were tried and what became of them.

    Examples
    --------
    >>> none = Proposals(reason="the cloud is empty")
    >>> len(none), bool(none), none.reason
    (0, False, 'the cloud is empty')
    """

    candidates: tuple[GraspCandidate, ...] = ()
    reason: str = ""
    notes: tuple[str, ...] = ()
    counts: Mapping[str, int] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.candidates)

    def __iter__(self) -> Iterator[GraspCandidate]:
        return iter(self.candidates)

    def __getitem__(self, index: int) -> GraspCandidate:
        return self.candidates[index]
