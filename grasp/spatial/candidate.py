"""A grasp candidate in space and what is known about it (Kehoe 2014, 4.4; Gatto 2016, 3.3.3)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from grasp.spatial.frames import planar_from_pose
from grasp.spatial.planar import PlanarGrasp

__all__ = ["Antipodal", "GraspCandidate", "Proposals", "Source", "to_planar"]

Source = Literal["mesh", "cloud", "planar", "recalled"]
Antipodal = Literal["full", "half", "none"]


@dataclass(frozen=True, eq=False)
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
    segment
        Number of the object in its scene, where there are several.
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
    segment: int | None = None
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
    advice
        What would help where there is none; "" when nothing is known to.

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
    advice: str = ""

    def __len__(self) -> int:
        return len(self.candidates)

    def __iter__(self) -> Iterator[GraspCandidate]:
        return iter(self.candidates)

    def __getitem__(self, index: int) -> GraspCandidate:
        return self.candidates[index]


def to_planar(
    candidate: GraspCandidate, support_height: float = 0.0, max_tilt: float = np.deg2rad(20)
) -> PlanarGrasp:
    """Return a candidate that comes from above as (X, Y, theta) (Gatto 2016, 3.3.4).

    Parameters
    ----------
    candidate
        In a frame whose z points up.
    support_height
        Of the support in that frame, m.

    Raises
    ------
    ValueError
        When the approach is more than ``max_tilt`` rad off the vertical.

    Examples
    --------
    >>> from grasp.spatial.frames import pose_from_planar
    >>> planar = to_planar(GraspCandidate(pose_from_planar(0.1, 0.2, 0.3, 0.5), 0.04))
    >>> round(planar.x, 3), round(planar.theta, 3)
    (0.1, 0.5)
    """
    x, y, z, theta = planar_from_pose(candidate.frame_from_gripper, max_tilt)
    return PlanarGrasp(
        x, y, z - support_height, theta, candidate.width,
        candidate.width if candidate.opening is None else candidate.opening,
        candidate.scores.get("confidence", 0.0), antipodal=candidate.antipodal,
        clearance=candidate.scores.get("clearance", 0.0),
    )  # fmt: skip
