"""Planning of grasps in piles and clutter: from one cloud of a scene to ranked grasps.

Gatto 2016, chapter 5, asks for grasps in clutter, which its own segments do not give: things touch,
lie on each other and hide each other's sides. Every object of the scene is here target and
obstacle at once. Hands are searched on the scene as it is seen (ten Pas and Platt 2015), and object
by object with the hidden side completed; all are scored on the same surfaces.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from grasp.arrays import FloatArray, IntArray
from grasp.spatial.boxes import boxes_meet_mesh
from grasp.spatial.candidate import GraspCandidate, Proposals
from grasp.spatial.clouds.cloud import SURFEL_VOXELS, SurfaceCloud, prepare_cloud
from grasp.spatial.clouds.completion import complete_by_symmetry
from grasp.spatial.gripper import ParallelGripper
from grasp.spatial.hand_search.hand_search import propose_on
from grasp.spatial.meshes.mesh import Mesh, surfels
from grasp.spatial.scoring.confidence import PoseNoise, score_grasps
from grasp.spatial.scoring.select import diverse

__all__ = ["SceneOptions", "plan_on_scene"]

_MAX_SCORED = 60
_SWEEP_M = 0.05
_VOXEL_M, _TABLE_VOXELS = 0.003, 2.0
_BESIDE_M = 0.02
_CLUSTER_VOXELS = 2.5
_MIN_VOXELS, _MAX_OBJECTS = 12, 100
_PER_M, _SIDEWAYS, _MOVING = 1.5, 0.1, 0.5
"""Worth in s_G of a metre of height, of an approach from the side, of touching other objects."""


@dataclass(frozen=True)
class SceneOptions:
    """Options of planning grasps in a scene.

    Parameters
    ----------
    noise
        Of the scene's pose relative to the gripper.
    samples
        Perturbed poses for each candidate.
    hands
        Places at which a hand is tried on the scene, and as many again over all objects.
    complete
        Whether hidden sides of objects are completed; False plans on what is seen alone.
    most
        Grasps in the result.
    seed
        Of every draw.
    """

    noise: PoseNoise = field(default_factory=PoseNoise)
    samples: int = 50
    hands: int = 200
    complete: bool = True
    most: int = 50
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("samples", "hands", "most"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: expected at least 1, got {getattr(self, name)}")


def plan_on_scene(
    points: FloatArray,
    gripper: ParallelGripper,
    viewpoints: FloatArray | None = None,
    *,
    labels: ArrayLike | None = None,
    table: FloatArray | None = None,
    options: SceneOptions | None = None,
) -> Proposals:
    """Plan grasps of whatever a cloud of a scene shows, each with its neighbours as obstacles.

    Parameters
    ----------
    points : (n, 3), m
        Of the scene: things that may touch, lie on each other and hide each other, with or without
        the table. Rows that are not finite are left out.
    viewpoints : (k, 3) or None, m
        Where cameras were; None = seen from all around.
    labels : (n,) int or None
        The object that each point belongs to, 0 = none, as a segmentation finds them; None =
        clusters of points that are apart.
    table : (4,) or None
        Plane under the objects, n . p + d = 0 with n upwards.

    Returns
    -------
    Proposals
        In the frame of ``points``, best first. Each candidate has its ``segment`` (a label, or the
        number of the cluster) and among its scores ``confidence``, ``lower_95``, ``clearance`` and
        ``moves``: the share of pose errors under which the open gripper would touch something else
        than its object on its way. ``counts`` says what became of the tries.

    Raises
    ------
    ValueError
        When an array has the wrong shape or a number is out of range; never for what points say.

    Notes
    -----
    Two contacts that lie on different objects are no grasp: closing would push things apart or
    lift one with another that lies loose. Hidden space counts as free; only objects that are seen
    are obstacles, their hidden sides as far as they are completed. Of more than 100 objects only
    the largest are completed and searched one by one, which ``notes`` says.

    Examples
    --------
    >>> from grasp.spatial.gripper import panda_hand
    >>> from grasp.spatial.meshes.shapes import box_mesh
    >>> rng = np.random.default_rng(0)
    >>> box = box_mesh((0.04, 0.06, 0.06))
    >>> boxes = [box.sample(3000, rng)[0] + (x, 0, 0.03) for x in (0, 0.05)]
    >>> found = plan_on_scene(np.vstack(boxes), panda_hand(), table=np.array([0, 0, 1.0, 0]),
    ...                       labels=np.repeat([1, 2], 3000))
    >>> {one.segment for one in found}
    {1, 2}
    >>> bool(abs(found[0].closing[1]) > 0.9)  # no finger fits between the two
    True
    """
    options = options or SceneOptions()
    points, owners = _checked(points, labels)
    if table is not None and len(points):
        plane = np.asarray(table, dtype=np.float64)
        scale = float(np.linalg.norm(plane[:3])) if plane.shape == (4,) else 0.0
        # What lies on the table is not grasped, and the plane stands for it as an obstacle.
        if scale > 0:
            above = (points @ plane[:3] + plane[3]) / scale > _TABLE_VOXELS * _VOXEL_M
            if above.any():
                points, owners = points[above], owners[above] if owners is not None else None
    cloud = prepare_cloud(points, table=table, viewpoints=viewpoints, voxel=_VOXEL_M)
    if cloud.reason:
        return Proposals(reason=cloud.reason, notes=cloud.notes)
    scene = _Scene.of(cloud, points, owners, options.complete)
    counts: Counter[str] = Counter(objects=len(scene.numbers))
    candidates: list[GraspCandidate] = []
    for part, share in scene.searches():
        hands = max(round(options.hands * share), 1)
        some = propose_on(part, gripper, hands, options.seed)
        counts.update(some.counts)
        candidates += some.candidates
    candidates = scene.assigned(candidates, counts)
    if not candidates:
        reason = "no hand closes on a single object with room for its open fingers"
        return Proposals(reason=reason, notes=scene.cloud.notes, counts=dict(counts))
    ranked = _ranked(scene, candidates, gripper, options)
    return Proposals(tuple(ranked), "", scene.cloud.notes, dict(counts))


def _checked(points: FloatArray, labels: ArrayLike | None) -> tuple[FloatArray, IntArray | None]:
    """Return the finite points and their labels."""
    array = np.asarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"points must have shape (n, 3) in m, got {array.shape}")
    finite = np.isfinite(array).all(axis=1)
    if labels is None:
        return array[finite], None
    owners = np.asarray(labels)
    if owners.shape != array.shape[:1] or not np.issubdtype(owners.dtype, np.integer):
        raise ValueError(
            f"labels must be integers of shape ({len(array)},), one for each point, got "
            f"{owners.dtype} {owners.shape}"
        )
    return array[finite], owners[finite].astype(np.int64)


@dataclass(frozen=True, eq=False)
class _Scene:
    """A scene's voxels with the objects that they belong to.

    Parameters
    ----------
    cloud
        As seen.
    owner : (n,) int
        Object of each voxel, 0 = none.
    numbers
        Of the objects.
    parts
        For each object the cloud in which it is the target and all others are obstacles, hidden
        side completed.
    """

    cloud: SurfaceCloud
    owner: IntArray
    numbers: tuple[int, ...]
    parts: dict[int, SurfaceCloud]
    _surfaces: dict[int, Mesh] = field(default_factory=dict, repr=False)

    @classmethod
    def of(
        cls, cloud: SurfaceCloud, points: FloatArray, owners: IntArray | None, complete: bool
    ) -> _Scene:
        owner = _clusters(cloud) if owners is None else _nearest(cloud, points, owners)
        if len(cloud.viewpoints) == 0:
            cloud = replace(cloud, normals=_outward(cloud, owner), _grids={})
        present, sizes = np.unique(owner[owner > 0], return_counts=True)
        large = np.flatnonzero(sizes >= _MIN_VOXELS)
        if len(large) > _MAX_OBJECTS:
            note = f"grasps planned of the {_MAX_OBJECTS} largest of {len(large)} objects"
            cloud = replace(cloud, notes=(*cloud.notes, note), _grids={})
            order = np.argsort(-sizes[large], kind="stable")
            large = np.sort(large[order[:_MAX_OBJECTS]])
        numbers = tuple(int(k) for k in present[large])
        parts = {}
        for k in numbers:
            part = replace(cloud, target=owner == k, _grids={})
            parts[k] = complete_by_symmetry(part) if complete else part
        return cls(cloud, owner, numbers, parts)

    def searches(self) -> list[tuple[SurfaceCloud, float]]:
        """Return the clouds to search with their shares of the hands: the scene, each object."""
        sizes = np.array([int((self.owner == k).sum()) for k in self.numbers], dtype=np.float64)
        clouds = [(self.cloud, 1.0)]
        if len(sizes):
            # Half evenly, half by size: small things must not go without a try.
            shares = 0.5 / len(sizes) + 0.5 * sizes / sizes.sum()
            clouds += [(self.parts[k], float(s)) for k, s in zip(self.numbers, shares, strict=True)]
        return clouds

    def assigned(
        self, candidates: Sequence[GraspCandidate], counts: Counter[str]
    ) -> list[GraspCandidate]:
        """Return the candidates that close on one object, with its number."""
        if not candidates:
            return []
        contacts = np.stack([c.contacts for c in candidates if c.contacts is not None])
        owned = np.flatnonzero(self.owner > 0)
        if len(contacts) != len(candidates) or not len(owned):
            return []
        points, owner = [self.cloud.points[owned]], [self.owner[owned]]
        for k, part in self.parts.items():
            points.append(part.points[part.completed])
            owner.append(np.full(int(part.completed.sum()), k))
        every, whose = np.vstack(points), np.concatenate(owner)
        away, near = cKDTree(every).query(contacts.reshape(-1, 3))
        whose_contact = np.where(away < _BESIDE_M, whose[near], 0).reshape(-1, 2)
        assigned = []
        for candidate, (left, right) in zip(candidates, whose_contact.tolist(), strict=True):
            if left and right and left != right:
                counts["two_objects"] += 1
            elif left or right:
                assigned.append(replace(candidate, segment=int(left or right)))
        return assigned

    def surface(self, *, without: int = 0) -> Mesh:
        """Return all surfaces, seen and completed, as small squares; ``without`` one object."""
        if without not in self._surfaces:
            self._surfaces[without] = self._surfels(without)
        return self._surfaces[without]

    def _surfels(self, without: int) -> Mesh:
        points, normals = [], []
        has_normal = (np.linalg.norm(self.cloud.normals, axis=1) > 0) & (
            self.owner != (without or -1)
        )
        points.append(self.cloud.points[has_normal])
        normals.append(self.cloud.normals[has_normal])
        for k, part in self.parts.items():
            if k != without:
                points.append(part.points[part.completed])
                normals.append(part.normals[part.completed])
        size = SURFEL_VOXELS * self.cloud.voxel
        return surfels(np.vstack(points), np.vstack(normals), size)


def _outward(cloud: SurfaceCloud, owner: IntArray) -> FloatArray:
    """Return the normals turned away from the middle of each object: no camera tells their side."""
    normals = cloud.normals.copy()
    for k in np.unique(owner):
        own = owner == k
        offset = cloud.points[own] - cloud.points[own].mean(axis=0)
        inward = np.einsum("ij,ij->i", normals[own], offset) < 0
        normals[own] = np.where(inward[:, None], -normals[own], normals[own])
    return normals


def _nearest(cloud: SurfaceCloud, points: FloatArray, owners: IntArray) -> IntArray:
    """Return the label of the point nearest to each voxel."""
    _, near = cKDTree(points).query(cloud.points)
    return np.asarray(owners[near], dtype=np.int64)


def _clusters(cloud: SurfaceCloud) -> IntArray:
    """Return the number of the cluster of each voxel, from 1."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    pairs = cKDTree(cloud.points).query_pairs(_CLUSTER_VOXELS * cloud.voxel, output_type="ndarray")
    ones = np.ones(len(pairs), dtype=np.int8)
    size = len(cloud.points)
    graph = coo_array((ones, (pairs[:, 0], pairs[:, 1])), shape=(size, size))
    number: NDArray[np.int32] = connected_components(graph, directed=False)[1]
    return number.astype(np.int64) + 1


def _ranked(
    scene: _Scene, candidates: list[GraspCandidate], gripper: ParallelGripper, options: SceneOptions
) -> list[GraspCandidate]:
    """Return the candidates with their scores, best first."""
    order = sorted(range(len(candidates)), key=lambda i: -_first_guess(scene, candidates[i]))
    shortlist = diverse([candidates[i] for i in order], gripper, most=_MAX_SCORED)
    scored = score_grasps(
        shortlist, scene.surface(), gripper, options.noise, samples=options.samples,
        exact=0, sweep=_SWEEP_M, seed=options.seed,
    )  # fmt: skip
    rescored = [
        replace(
            candidate,
            scores={**candidate.scores, "moves": _moves(scene, candidate, gripper, options)},
        )
        for candidate in scored
    ]
    return sorted(rescored, key=lambda candidate: -_value(scene, candidate))[: options.most]


def _first_guess(scene: _Scene, candidate: GraspCandidate) -> float:
    return candidate.scores["geometry"] + _from_above(scene, candidate)


def _from_above(scene: _Scene, candidate: GraspCandidate) -> float:
    """Return what speaks for a grasp high over the table and with a steep approach."""
    table = scene.cloud.table
    up, ground = (np.array([0, 0, 1.0]), 0.0) if table is None else (table[:3], float(table[3]))
    height = float(candidate.centre @ up) + ground
    return _PER_M * height - _SIDEWAYS * (1 + float(candidate.approach @ up))


def _value(scene: _Scene, candidate: GraspCandidate) -> float:
    return (
        candidate.scores["confidence"]
        + _from_above(scene, candidate)
        - _MOVING * candidate.scores["moves"]
    )


def _moves(
    scene: _Scene, candidate: GraspCandidate, gripper: ParallelGripper, options: SceneOptions
) -> float:
    """Return the share of pose errors under which the open gripper touches other objects."""
    others = scene.surface(without=candidate.segment or 0)
    if len(others.faces) == 0:
        return 0.0
    errors = options.noise.transforms(options.samples, options.seed)
    poses = np.ascontiguousarray(candidate.frame_from_gripper @ errors)
    opening = gripper.max_opening if candidate.opening is None else candidate.opening
    boxes = np.repeat(gripper.boxes(opening, _SWEEP_M)[None], len(poses), axis=0)
    return float(boxes_meet_mesh(*others.tree.arrays, poses, boxes).mean())
