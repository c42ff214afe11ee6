"""A grasp candidate in space and what is known about it (Kehoe 2014, 4.4; Gatto 2016, 3.3.3)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray
from grasp.spatial.frames import planar_from_pose
from grasp.spatial.gripper import ContactKind, EndEffector
from grasp.spatial.planar import PlanarGrasp

__all__ = [
    "Antipodal", "Contacts", "GraspCandidate", "Proposals", "Source", "contacts_of", "to_planar",
]  # fmt: skip

Source = Literal["mesh", "cloud", "planar", "recalled"]
Antipodal = Literal["full", "half", "none"]


_COUNTS = {"suction": (1, 1), "three_fingers": (2, 3)}
"""Contacts of each kind of hand, least and most: two of three fingers are enough to hold."""
_UNIT = 1e-3
_OFF_LIP_M, _OFF_FINGER_M = 0.01, 0.01


@dataclass(frozen=True, eq=False)
class Contacts:
    """Places on an object at which a lip seals or fingers push.

    Jaws have none of these: the middle of a pair of contacts, its direction and its length are
    what the pose and the width of a grasp say.

    Parameters
    ----------
    kind
        Of hand.
    points : (k, 3), m
        One of a lip, two or three of fingers about an axis.
    normals : (k, 3)
        Unit vectors **out of** the object.
    seal_radius
        Radius, m, of the lip that seals there; None for fingers.

    Raises
    ------
    ValueError
        The numbers are no contacts of such a hand.

    Examples
    --------
    >>> top = Contacts("suction", np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]), 0.015)
    >>> top.moved(np.diag([1.0, -1.0, -1.0, 1.0])).normals.tolist()
    [[0.0, 0.0, -1.0]]
    """

    kind: ContactKind
    points: FloatArray
    normals: FloatArray
    seal_radius: float | None = None

    def __post_init__(self) -> None:
        if self.kind == "jaws":
            raise ValueError("a grasp of jaws is its pose and width, without contacts")
        least, most = _COUNTS[self.kind]
        for name, rows in (("points", self.points), ("normals", self.normals)):
            if rows.ndim != 2 or rows.shape[1] != 3 or not least <= len(rows) <= most:
                expected = f"{most}" if least == most else f"{least} or {most}"
                raise ValueError(f"{name} of {self.kind}: {expected} rows of x, y, z, got "
                                 f"{rows.shape}")  # fmt: skip
            if not np.isfinite(rows).all():
                raise ValueError(f"{name} of {self.kind} must be finite")
        if len(self.points) != len(self.normals):
            raise ValueError(f"{len(self.points)} points and {len(self.normals)} normals")
        if not np.allclose(np.linalg.norm(self.normals, axis=1), 1.0, atol=_UNIT):
            raise ValueError(f"normals must be unit vectors, got {self.normals.tolist()}")
        radius = self.seal_radius
        if self.kind == "suction" and not (radius is not None and 0 < radius < np.inf):
            raise ValueError(f"a lip that seals has a radius in m, got {radius}")

    def moved(self, target_from_source: FloatArray) -> Contacts:
        """Return the same contacts in another frame, given the pose (4, 4) of theirs in it."""
        turn, shift = target_from_source[:3, :3], target_from_source[:3, 3]
        points, normals = self.points @ turn.T + shift, self.normals @ turn.T
        return Contacts(self.kind, points, normals, self.seal_radius)

    def within(self, source_from_target: FloatArray) -> Contacts:
        """Return the same contacts in the frame that has a pose (4, 4) in theirs."""
        target_from_source = np.asarray(np.linalg.inv(source_from_target), dtype=np.float64)
        return self.moved(target_from_source)

    def check_reach(self, hand: EndEffector) -> None:
        """Refuse contacts, given in the gripper frame, that a hand does not touch there.

        Raises
        ------
        ValueError
            A lip is elsewhere or faces away, or a finger cannot come to a contact.
        """
        if self.kind != hand.contact_kind:
            raise ValueError(f"contacts of {self.kind} are none of {hand.name!r}, which holds by "
                             f"{hand.contact_kind}")  # fmt: skip
        if self.kind == "suction":
            off = float(np.linalg.norm(self.points[0]))
            if off > _OFF_LIP_M:
                raise ValueError(f"the contact is {1000 * off:.0f} mm from the middle of the lip")
            if self.normals[0, 2] >= 0:
                raise ValueError("the normal points along the approach: it must point out of the "
                                 "object")  # fmt: skip
            return
        away = float(np.linalg.norm(self.points[:, :2], axis=1).max())
        if away > hand.max_opening / 2 + _OFF_FINGER_M:
            raise ValueError(f"a contact is {1000 * away:.0f} mm from the axis of the fingers, "
                             f"which open {1000 * hand.max_opening:.0f} mm")  # fmt: skip


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
    contacts, normals : (k, 3) or None, m
        Places that the hand touches and the normals there, **out of** the object. Two of jaws, of
        which row 0 is touched by the one at -x; three of three fingers.
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
    def score(self) -> float:
        """Chance to hold, 0..1: for cups and three fingers that of sealing or closing and then
        bearing the load, at rest and shaken; for jaws the confidence in their closing.
        """
        if "holding" in self.scores:
            return self.scores["holding"]
        return self.scores["confidence"]

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


def contacts_of(candidate: GraspCandidate, hand: EndEffector) -> Contacts | None:
    """Return the contacts of a candidate in its own frame; None for jaws.

    Fingers of which none are known touch the circle of the candidate's width.
    """
    pose = candidate.frame_from_gripper
    if hand.contact_kind == "jaws":
        return None
    if hand.contact_kind == "suction":
        return Contacts(
            "suction", pose[None, :3, 3], -pose[None, :3, 2], hand.finger_width / 2
        )  # fmt: skip
    if candidate.contacts is not None and candidate.normals is not None:
        return Contacts("three_fingers", candidate.contacts, candidate.normals)
    angles = 2 * np.pi * np.arange(3) / 3
    ways = np.stack([np.cos(angles), np.sin(angles), np.zeros(3)], axis=1)
    return Contacts("three_fingers", candidate.width / 2 * ways, ways).moved(pose)


def to_planar(candidate: GraspCandidate, support_height: float = 0.0) -> PlanarGrasp:
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
        When the approach is more than 20 degrees off the vertical.

    Examples
    --------
    >>> from grasp.spatial.frames import pose_from_planar
    >>> planar = to_planar(GraspCandidate(pose_from_planar(0.1, 0.2, 0.3, 0.5), 0.04))
    >>> round(planar.x, 3), round(planar.theta, 3)
    (0.1, 0.5)
    """
    x, y, z, theta = planar_from_pose(candidate.frame_from_gripper)
    return PlanarGrasp(
        x, y, z - support_height, theta, candidate.width,
        candidate.width if candidate.opening is None else candidate.opening,
        candidate.scores.get("confidence", 0.0), antipodal=candidate.antipodal,
        clearance=candidate.scores.get("clearance", 0.0),
    )  # fmt: skip
