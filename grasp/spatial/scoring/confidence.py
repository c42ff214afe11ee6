"""Probability that a grasp closes under an uncertain object pose (Kehoe 2014, 4.4).

The gripper is moved against the object by draws of the pose error; the confidence s_G is the share
of draws in which both jaws meet the object within the opening and the line between both contacts
lies inside both friction cones (Nguyen 1988). On request the open gripper must also touch nothing
on its way in, and its pads must hold the weight's torque about the line. All candidates see the
same draws, so that their order does not depend on luck.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from grasp.arrays import FloatArray
from grasp.push.quality import density_weights, lower_bound
from grasp.spatial.boxes import boxes_meet_mesh
from grasp.spatial.candidate import GraspCandidate
from grasp.spatial.collision import swept_boxes
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.meshes.rays import line_ends
from grasp.spatial.scoring.wrench import Contacts, epsilon, epsilon_bound

__all__ = [
    "MAX_SAMPLES",
    "Confidence",
    "Load",
    "PoseNoise",
    "closures",
    "confidences",
    "score_grasps",
]


Quality = Literal["closure", "epsilon"]
Weighting = Literal["plain", "density"]

MAX_SAMPLES = 100_000
"""Of pose errors."""

_EXACT = 20
_MIN_WIDTH = 1e-4


@dataclass(frozen=True, eq=False)
class PoseNoise:
    """Gaussian error of the object's pose relative to the gripper.

    Parameters
    ----------
    position_std
        Of each coordinate, m.
    rotation_std
        Of each component of the rotation vector, rad.
    covariance : (6, 6) or None
        Of x, y, z (m) and the rotation vector (rad) in the object's frame, about its origin, as a
        pose estimate states it; replaces both deviations, which are isotropic and act about the
        gripper's centre.
    """

    position_std: float = 0.004
    rotation_std: float = 0.1
    covariance: FloatArray | None = None

    def __post_init__(self) -> None:
        stds = (self.position_std, self.rotation_std)
        if not all(np.isfinite(s) and s >= 0 for s in stds):
            raise ValueError(f"deviations of a pose are finite and not negative, got {stds}")
        if self.covariance is not None:
            c = np.asarray(self.covariance, dtype=np.float64)
            if c.shape != (6, 6) or not np.isfinite(c).all() or not np.allclose(c, c.T):
                raise ValueError(f"a pose's covariance is symmetric (6, 6), got {c.shape}")

    def normals(self, samples: int, seed: int) -> FloatArray:
        """Draw standard normals (samples, 6)."""
        return np.random.default_rng([0x5EED, seed]).standard_normal((samples, 6))

    def transforms(self, samples: int, seed: int) -> FloatArray:
        """Return errors as transforms (samples, 4, 4): gripper from gripper, or object from object.

        Which of both depends on :attr:`covariance`.
        """
        from scipy.spatial.transform import Rotation

        draws = self.normals(samples, seed)
        if self.covariance is None:
            draws = draws * np.repeat([self.position_std, self.rotation_std], 3)
        else:
            # Eigenvectors, since a covariance may lack full rank, which Cholesky's factor does not
            # allow.
            values, vectors = np.linalg.eigh(np.asarray(self.covariance, dtype=np.float64))
            draws = draws @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
        moved = np.tile(np.eye(4), (samples, 1, 1))
        moved[:, :3, :3] = Rotation.from_rotvec(draws[:, 3:]).as_matrix()
        moved[:, :3, 3] = draws[:, :3]
        return moved


@dataclass(frozen=True)
class Load:
    """The weight that a grasp has to hold.

    Parameters
    ----------
    mass
        kg.
    up : (3,)
        Unit vector against gravity in the object's frame.
    patch
        Mean radius at which a pad's friction acts against torsion, m: each jaw takes a torque of
        friction x force x patch about the closing axis.
    """

    mass: float
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    patch: float = 0.004

    def __post_init__(self) -> None:
        if not (np.isfinite(self.mass) and self.mass > 0 and self.patch > 0):
            raise ValueError(f"mass (kg) and patch (m) are positive, got {self.mass}, {self.patch}")

    def is_held(
        self, origins: FloatArray, closing: FloatArray, com: FloatArray, gripper: ParallelGripper
    ) -> NDArray[np.bool_]:
        """Tell which lines (..., 3) of closing hold the weight: its force and its torque."""
        weight = 9.81 * self.mass
        torque = np.cross(com - origins, -weight * np.array(self.up))
        twist = np.abs(np.einsum("...i,...i->...", torque, closing))
        # Two pads hold, each by its own friction.
        grip = 2 * gripper.friction * gripper.max_force
        return np.asarray((twist <= grip * self.patch) & (weight <= grip))


@dataclass(frozen=True, eq=False)
class Confidence:
    """Results of the perturbations for each of several grasps.

    Parameters
    ----------
    value : (c,)
        s_G: mean quality over the perturbations.
    lower_95 : (c,)
        One-sided bound below it; Clopper and Pearson for closure, normal for epsilon.
    closed : (c, K) bool
        Which perturbations close.
    """

    value: FloatArray
    lower_95: FloatArray
    closed: NDArray[np.bool_]


def closures(
    mesh: Mesh,
    poses: FloatArray,
    gripper: ParallelGripper,
    errors: FloatArray,
    openings: FloatArray | None = None,
) -> NDArray[np.bool_]:
    """Return which grasps (c, K) close on the mesh under which errors.

    Parameters
    ----------
    poses : (c, 4, 4)
        ``mesh_from_gripper``.
    errors : (K, 4, 4)
        Of the gripper, in its own frame.
    openings : (c,) or None, m
        Between the jaws before closing; None = the stroke.
    """
    return _swept(mesh, poses, gripper, errors, openings, None, in_object=False)[0] > 0


def confidences(
    mesh: Mesh,
    poses: FloatArray,
    gripper: ParallelGripper,
    noise: PoseNoise | None = None,
    *,
    samples: int = 100,
    openings: FloatArray | None = None,
    quality: Quality = "closure",
    weighting: Weighting = "plain",
    friction: float | None = None,
    sweep: float | None = None,
    load: Load | None = None,
    middles: FloatArray | None = None,
    seed: int = 0,
) -> Confidence:
    """Return the confidences of grasps under pose uncertainty.

    Parameters
    ----------
    mesh
        Of the object, in the frame of the poses.
    poses : (c, 4, 4)
        ``object_from_gripper``.
    noise
        None = 4 mm and .1 rad.
    samples
        K, perturbations of each grasp, the same for all.
    openings : (c,) or None, m
        Between the jaws before closing; None = the stroke.
    quality
        ``closure`` (0 or 1 each) or ``epsilon`` (how strong a disturbance is resisted).
    weighting
        ``plain`` mean, or weighted by the ``density`` of the draws once more, as the text has it:
        in six dimensions fewer than half of the draws then carry the weight.
    friction
        None = the gripper's.
    sweep
        Length of the straight approach, m, on which the open gripper must not touch the object;
        None = not looked at, which is many times as fast.
    load
        The weight to be held; None = not looked at.
    middles : (c, 3) or None, m
        Points of the closing lines midway between the contacts, where they do not run through the
        poses' origins: pads hold low things with their tips.

    Examples
    --------
    >>> from grasp.spatial.gripper import panda_hand
    >>> from grasp.spatial.meshes.shapes import box_mesh
    >>> found = confidences(box_mesh((0.04, 0.06, 0.1)), np.eye(4)[None], panda_hand())
    >>> bool(found.value[0] > 0.95), bool(found.lower_95[0] < found.value[0])
    (True, True)
    """
    if samples < 1:
        raise ValueError(f"at least one perturbation is needed, got {samples}")
    if samples > MAX_SAMPLES:
        raise ValueError(f"{samples} perturbations are too many: at most {MAX_SAMPLES}")
    noise = noise or PoseNoise()
    errors = noise.transforms(samples, seed)
    in_object = noise.covariance is not None
    opening = np.full(len(poses), gripper.max_opening) if openings is None else openings
    lines = np.array(poses, dtype=np.float64)
    if middles is not None:
        # The lines of closing go through the contacts, which need not lie at the hand's middle.
        lines[:, :3, 3] = middles
    closed, ends = _swept(mesh, lines, gripper, errors, opening, friction, in_object)
    if load is not None:
        moved = _moved(lines, errors, in_object)
        closed &= load.is_held(moved[..., :3, 3], moved[..., :3, 0], mesh.com, gripper)
    if sweep is not None:
        _without_collisions(closed, mesh, gripper, _moved(poses, errors, in_object), opening, sweep)
    weights = np.full(samples, 1.0 / samples)
    if weighting == "density":
        weights = density_weights(noise.normals(samples, seed))
        weights = weights / weights.sum()
    elif weighting != "plain":
        raise ValueError(f"weighting is plain or density, got {weighting!r}")
    if quality == "closure":
        effective = 1.0 / float((weights**2).sum())
        # Rounded, so that the order of a sum does not reorder equal grasps.
        share = np.clip(np.round(closed @ weights, 12), 0.0, 1.0)
        return Confidence(share, lower_bound(share * effective, np.full(len(share), effective)),
                          closed > 0)  # fmt: skip
    if quality != "epsilon":
        raise ValueError(f"quality is closure or epsilon, got {quality!r}")
    mu = gripper.friction if friction is None else friction
    values = _epsilons(mesh, lines, errors, closed, ends, mu, in_object)
    mean = values @ weights
    spread = np.sqrt(np.maximum(((values - mean[:, None]) ** 2) @ weights, 0.0) / samples)
    return Confidence(mean, np.maximum(mean - 1.645 * spread, 0.0), closed > 0)


def score_grasps(
    candidates: Sequence[GraspCandidate],
    mesh: Mesh,
    gripper: ParallelGripper,
    noise: PoseNoise | None = None,
    *,
    samples: int = 100,
    quality: Quality = "closure",
    weighting: Weighting = "plain",
    exact: int = _EXACT,
    sweep: float | None = None,
    load: Load | None = None,
    seed: int = 0,
) -> list[GraspCandidate]:
    """Return the candidates with ``confidence``, ``lower_95``, ``lever`` and ``epsilon`` as scores.

    ``lever`` is the distance (m) from the centre of mass to the middle of the contacts.

    Parameters
    ----------
    sweep, load
        See :func:`confidences`.
    exact
        How many of the most confident get the exact epsilon; the others an upper bound of it.
    """
    if not candidates:
        return []
    poses = np.stack([c.frame_from_gripper for c in candidates])
    middles = np.stack(
        [c.centre if c.contacts is None else c.contacts.mean(axis=0) for c in candidates]
    )
    openings = np.array(
        [gripper.max_opening if c.opening is None else c.opening for c in candidates]
    )
    estimates = confidences(
        mesh, poses, gripper, noise, samples=samples, openings=openings, quality=quality,
        weighting=weighting, sweep=sweep, load=load, middles=middles, seed=seed,
    )  # fmt: skip
    # The exact measure is much dearer than its bound; only the best are worth it.
    best = set(np.argsort(-estimates.value, kind="stable")[:exact].tolist())
    scored = []
    for i, candidate in enumerate(candidates):
        scores = {
            **candidate.scores,
            "confidence": float(estimates.value[i]),
            "lower_95": float(estimates.lower_95[i]),
            "lever": float(np.linalg.norm(middles[i] - mesh.com)),
        }
        if candidate.contacts is not None and candidate.normals is not None:
            contacts = Contacts(
                candidate.contacts, candidate.normals, mesh.com, mesh.radius, candidate.approach
            )
            measure = epsilon if i in best else epsilon_bound
            scores["epsilon"] = measure(contacts, gripper.friction)
        scored.append(replace(candidate, scores=scores))
    return scored


def _swept(
    mesh: Mesh, poses: FloatArray, gripper: ParallelGripper, errors: FloatArray,
    openings: FloatArray | None, friction: float | None, in_object: bool,
) -> tuple[NDArray[np.uint8], FloatArray]:  # fmt: skip
    poses = np.ascontiguousarray(poses, dtype=np.float64)
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise ValueError(f"poses have shape (c, 4, 4), got {poses.shape}")
    opening = np.full(len(poses), gripper.max_opening) if openings is None else openings
    opening = np.ascontiguousarray(opening, dtype=np.float64)
    closed = np.zeros((len(poses), len(errors)), np.uint8)
    ends = np.full((len(poses), len(errors), 4), np.nan)
    if len(mesh.faces) and len(poses):
        mu = gripper.friction if friction is None else friction
        cone = float(np.cos(np.arctan(mu)))
        least = max(gripper.min_opening, _MIN_WIDTH)
        _close(*mesh.tree.arrays, mesh.tree.normals, poses, errors, in_object, opening, cone,
               least, closed, ends)  # fmt: skip
    return closed, ends


def _moved(poses: FloatArray, errors: FloatArray, in_object: bool) -> FloatArray:
    """Return the poses (c, K, 4, 4) of grippers off by errors."""
    if in_object:
        return np.asarray(errors[None] @ poses[:, None])
    return np.asarray(poses[:, None] @ errors[None])


def _without_collisions(
    closed: NDArray[np.uint8], mesh: Mesh, gripper: ParallelGripper, moved: FloatArray,
    openings: FloatArray, sweep: float,
) -> None:  # fmt: skip
    """Clear ``closed`` (c, K) where the open gripper would touch the mesh on its approach."""
    g, k = np.nonzero(closed)
    if len(g) == 0:
        return
    boxes = swept_boxes(gripper, openings, sweep)[g]
    touched = boxes_meet_mesh(*mesh.tree.arrays, np.ascontiguousarray(moved[g, k]), boxes)
    closed[g[touched], k[touched]] = 0


@njit(cache=True, nogil=True)
def _close(  # type: ignore[no-untyped-def]
    c, e1, e2, boxes, nodes, normals, poses, errors, in_object, openings, cone, least, closed, ends
):
    """Fill ``closed`` (c, K) and ``ends`` (c, K, 4): distances and triangles of both contacts."""
    stack = np.empty(128, np.int64)
    o, d = np.empty(3), np.empty(3)
    for g in range(len(poses)):
        p, half = poses[g], openings[g] / 2
        for k in range(len(errors)):
            e = errors[k]
            for i in range(3):
                if in_object:
                    o[i] = e[i, 0] * p[0, 3] + e[i, 1] * p[1, 3] + e[i, 2] * p[2, 3] + e[i, 3]
                    d[i] = e[i, 0] * p[0, 0] + e[i, 1] * p[1, 0] + e[i, 2] * p[2, 0]
                else:
                    o[i] = p[i, 0] * e[0, 3] + p[i, 1] * e[1, 3] + p[i, 2] * e[2, 3] + p[i, 3]
                    d[i] = p[i, 0] * e[0, 0] + p[i, 1] * e[1, 0] + p[i, 2] * e[2, 0]
            first, a, last, b = line_ends(
                c, e1, e2, boxes, nodes, o[0], o[1], o[2], d[0], d[1], d[2], half, stack
            )
            # Neither surface was met, or the hand would close on less than it can.
            if a < 0 or last - first < least:
                continue
            left = normals[a, 0] * d[0] + normals[a, 1] * d[1] + normals[a, 2] * d[2]
            right = normals[b, 0] * d[0] + normals[b, 1] * d[1] + normals[b, 2] * d[2]
            if -left >= cone and right >= cone:
                closed[g, k] = 1
                ends[g, k, 0], ends[g, k, 1] = first, last
                ends[g, k, 2], ends[g, k, 3] = a, b


def _epsilons(
    mesh: Mesh, poses: FloatArray, errors: FloatArray, closed: NDArray[np.uint8],
    ends: FloatArray, mu: float, in_object: bool,
) -> FloatArray:  # fmt: skip
    """Return the quality (c, K) of each closed grasp, 0 for the others."""
    values = np.zeros(closed.shape)
    for g, k in zip(*np.nonzero(closed), strict=True):
        moved = errors[k] @ poses[g] if in_object else poses[g] @ errors[k]
        at, faces = ends[g, k, :2], ends[g, k, 2:].astype(np.int64)
        contacts = moved[:3, 3] + at[:, None] * moved[:3, 0]
        normals = mesh.tree.normals[faces]
        touched = Contacts(contacts, normals, mesh.com, mesh.radius, moved[:3, 2])
        values[g, k] = epsilon_bound(touched, mu)
    return values
