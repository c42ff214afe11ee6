"""Suction cups: where a lip seals on a mesh, and what the vacuum then holds.

After Mahler et al. (2018, Dex-Net 3.0): a ring of points of the lip is pressed onto the surface; it
seals where the lip's compliance makes up for their differences in depth and nothing within breaks
the surface. The vacuum holds while the load's pull, shear, torsion and tipping moment together stay
within what the force of the pressure bears.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from grasp.arrays import FloatArray
from grasp.spatial.candidate import GraspCandidate, Proposals
from grasp.spatial.clouds.cloud import prepare_cloud
from grasp.spatial.clouds.completion import complete_by_symmetry
from grasp.spatial.collision import Support, Surroundings, room_around
from grasp.spatial.grasp_plan import SpatialOptions
from grasp.spatial.meshes.mesh import Mesh
from grasp.spatial.meshes.rays import NOTHING, first_and_last
from grasp.spatial.scoring.object_load import ObjectLoad, load_to_plan_for
from grasp.spatial.scoring.pose_errors import Judged, scored_under_errors
from grasp.spatial.scoring.select import diverse, rank
from grasp.spatial.suction_cup import SuctionCup

__all__ = [
    "asked_of_vacuum", "lip_places", "plan_suction", "plan_suction_on_cloud", "sealed", "seals_at",
]  # fmt: skip

_LIP, _INNER = 16, 8
_REACH_M = 0.03
_STEEP = float(np.cos(np.deg2rad(50.0)))
_SCREENED, _SCORED = 400, 60
_GRAVITY = 9.81
_SHAKEN_G = 1.5
_NO_ROOM = "the cup touches something, or cannot be brought there, wherever it would seal"


def sealed(mesh: Mesh, cup: SuctionCup, poses: FloatArray) -> NDArray[np.bool_]:
    """Return whether a cup seals on a mesh, (n,) bool.

    Parameters
    ----------
    poses : (n, 4, 4)
        ``mesh_from_gripper``; how far the cup is from the surface does not matter, as far as 3 cm:
        an arm stops at contact.
    """
    places = lip_places(cup)
    if len(poses) == 0 or len(mesh.faces) == 0:
        return np.zeros(len(poses), dtype=bool)
    origins = (
        poses[:, None, :3, 3]
        + places[None, :, :1] * poses[:, None, :3, 0]
        + places[None, :, 1:] * poses[:, None, :3, 1]
    )
    ways = np.broadcast_to(poses[:, None, :3, 2], origins.shape)
    at, face = first_and_last(mesh.tree, origins.reshape(-1, 3), ways.reshape(-1, 3), _REACH_M)
    # A ray that meets nothing has no face; its depth is NaN, so whose normal it gets is no matter.
    depth = np.where(face[:, 0] != NOTHING, at[:, 0], np.nan).reshape(len(poses), -1)
    normal = mesh.normals[np.maximum(face[:, 0], 0)].reshape(origins.shape)
    return seals_at(cup, depth, -np.einsum("nki,ni->nk", normal, poses[:, :3, 2]))


def seals_at(cup: SuctionCup, depth: FloatArray, facing: FloatArray) -> NDArray[np.bool_]:
    """Return whether a cup seals on what lies before its lip, (n,) bool.

    Parameters
    ----------
    depth : (n, p), m
        From the plane of the lip to the surface at :func:`lip_places`; NaN = there is none.
    facing : (n, p)
        Cosine of the angle between the surface's normal and the way back.
    """
    lip, inner = depth[:, :_LIP], depth[:, _LIP:]
    low, high = lip.min(axis=1, keepdims=True), lip.max(axis=1, keepdims=True)
    # Comparisons with NaN are false, so a hole under the lip or within it does not seal.
    tight = (high - low)[:, 0] <= cup.give
    whole = ((inner >= low - cup.give) & (inner <= high + cup.radius)).all(axis=1)
    return np.asarray(tight & whole & (facing[:, :_LIP] > _STEEP).all(axis=1))


def lip_places(cup: SuctionCup) -> FloatArray:
    """Return places (n, 2) in the plane of the lip, m: on the lip, half way in, in the middle."""
    rings = []
    for count, radius in ((_LIP, cup.radius), (_INNER, cup.radius / 2)):
        angle = 2 * np.pi * np.arange(count) / count
        rings.append(radius * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    return np.vstack([*rings, np.zeros((1, 2))])


def _loads(up: FloatArray, shaken: bool) -> FloatArray:
    """Return accelerations (k, 3), g, against which a cup holds: lifting, or carrying.

    Carried things are shaken by 1.5 g along the vertical and across it.
    """
    up = np.asarray(up, dtype=np.float64)
    if not shaken:
        return -up[None]
    # Of the axes the one farthest from "up": with a near one the product would be mostly rounding.
    side = np.cross(up, np.eye(3)[int(np.abs(up).argmin())])
    side /= np.linalg.norm(side)
    ways = np.array([up, side, np.cross(up, side)])
    return np.asarray(-up + _SHAKEN_G * np.vstack([ways, -ways]))


def asked_of_vacuum(cup: SuctionCup, force: FloatArray, moment: FloatArray) -> FloatArray:
    """Return what loads ask of a sealed cup, as a share of what it bears: it holds below 1, (...).

    Shear, torsion and the moment that tips the lip are shares of what the force of the vacuum less
    the pull bears (an ellipsoid, as of soft contacts); infinite where the pull exceeds it.

    Parameters
    ----------
    force, moment : (..., 3), N and N m
        Of the object on the cup in the gripper frame, about the middle of the lip.

    Examples
    --------
    >>> cup = SuctionCup("cup")
    >>> hanging, beside = np.array([0, 0, 10.0]), np.array([10.0, 0, 0])
    >>> none = np.zeros(3)
    >>> [round(float(asked_of_vacuum(cup, f, none)), 2) for f in (hanging, beside, 5 * hanging)]
    [0.0, 0.47, inf]
    """
    left = cup.force - force[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        shear = np.hypot(force[..., 0], force[..., 1]) / (cup.friction * left)
        torsion = moment[..., 2] / (cup.friction * cup.radius * left)
        tipping = np.hypot(moment[..., 0], moment[..., 1]) / (cup.radius * left)
        asked = np.sqrt(shear**2 + torsion**2 + tipping**2)
    # Beyond the force of the vacuum the shares change sign and could look small.
    return np.asarray(np.where(left > 0, asked, np.inf))


def _asked(
    cup: SuctionCup, poses: FloatArray, com: FloatArray, mass: float, loads: FloatArray
) -> FloatArray:
    """Return the most that accelerations (k, 3), g, of a mass at ``com`` ask of poses, (n,)."""
    force = np.einsum("nji,kj->nki", poses[:, :3, :3], loads) * mass * _GRAVITY
    lever = np.einsum("nji,nj->ni", poses[:, :3, :3], com - poses[:, :3, 3])
    asked = asked_of_vacuum(cup, force, np.cross(lever[:, None], force))
    return np.asarray(asked.max(axis=1))


def _levers(poses: FloatArray, com: FloatArray) -> FloatArray:
    """Return the distances (n,), m, of a centre of mass from the axes of cups at poses."""
    return np.asarray(np.linalg.norm(np.cross(com - poses[:, :3, 3], poses[:, :3, 2]), axis=1))


def plan_suction(
    mesh: Mesh,
    cup: SuctionCup,
    surroundings: Surroundings | None = None,
    options: SpatialOptions | None = None,
    given: FloatArray | None = None,
) -> Proposals:
    """Plan places on a mesh at which a cup takes it.

    Parameters
    ----------
    surroundings
        Support and neighbours in the mesh's frame; None = the object floats alone, and "up" is z.
    given : (n, 4, 4) or None
        Poses of the cup in that frame that are ranked instead of own ones.

    Returns
    -------
    Proposals
        Ranked. ``confidence`` is the share of pose errors under which the lip seals; ``lift`` and
        ``carry`` how likely it also holds the load, shaken by 1.5 g for ``carry``. What a stated
        ``mass`` exceeds is left out; an assumed one only orders, halved until a place bears it.

    Examples
    --------
    >>> from grasp.spatial.collision import Support
    >>> from grasp.spatial.meshes.shapes import box_mesh
    >>> box, on_table = box_mesh((0.1, 0.06, 0.04)), Surroundings(Support(-0.02))
    >>> best = plan_suction(box, SuctionCup("cup"), on_table)[0]
    >>> [round(float(v)) for v in best.approach], best.scores["carry"] > 0.8
    ([0, 0, -1], True)
    """
    options, around = options or SpatialOptions(), surroundings or Surroundings()
    load = load_to_plan_for(mesh, options.mass, around.support)
    if isinstance(load, Proposals):
        return load
    return _plan(mesh, cup, around, options, load, given)


def _plan(
    mesh: Mesh, cup: SuctionCup, around: Surroundings, options: SpatialOptions, load: ObjectLoad,
    given: FloatArray | None = None,
) -> Proposals:  # fmt: skip
    """Return the proposals of :func:`plan_suction` for a load."""
    notes, mass, up = (*mesh.notes, *load.notes), load.mass, load.up
    if given is None:
        points, faces = mesh.sample(options.tries, np.random.default_rng(options.seed))
        poses = _facing(points, mesh.normals[faces], up)
    else:
        poses = given
    counts = {"tried": len(poses)}
    tight = sealed(mesh, cup, poses)
    counts["lip does not seal"] = int((~tight).sum())
    poses = poses[tight]
    if not len(poses):
        reason = f"the lip of {1000 * cup.radius:.0f} mm radius seals nowhere on the object"
        return Proposals(reason=reason, notes=notes, counts=counts)
    room = room_around(poses, np.zeros(len(poses)), cup, around, mesh)
    counts.update({f"touches the {name}": n for name, n in room.hits().items() if n})
    poses, away = poses[room.free], room.clearance[room.free]
    if not len(poses):
        return Proposals(reason=_NO_ROOM, notes=notes, counts=counts)
    shaken = _loads(up, shaken=True)
    asked = _asked(cup, poses, mesh.com, mass, shaken)
    if not (asked < 1).any():
        reason = f"{cup.force:.0f} N of vacuum do not bear {mass:.2g} kg when shaken"
        if not load.is_assumed:
            counts["vacuum too weak"] = len(asked)
            return Proposals(reason=reason, notes=notes, counts=counts)
        # If the cup can take the object at all, it is lighter than was assumed.
        while not (asked < 1).any():
            mass /= 2
            asked = _asked(cup, poses, mesh.com, mass, shaken)
        notes = (*notes, f"{reason}: ordered for {mass:.2g} kg")
    # Rounded, so that rigid motions change nothing; what exceeds the vacuum goes by its lever.
    order = np.lexsort((np.round(_levers(poses, mesh.com), 9), np.round(asked, 9)))
    if not load.is_assumed:
        counts["vacuum too weak"] = int((asked >= 1).sum())
        order = order[asked[order] < 1]
    candidates = [
        GraspCandidate(poses[i], 0.0, opening=cup.give, scores={"clearance": float(away[i])})
        for i in order[:_SCREENED]
        if options.reachable is None or options.reachable(poses[i])
    ]
    if not candidates:
        return Proposals(reason=_NO_ROOM, notes=notes, counts=counts)
    chosen = diverse(candidates, cup, most=_SCORED)
    scored = _scored(chosen, mesh, cup, mass, up, options)
    return Proposals(tuple(rank(scored, up)[: options.most]), notes=notes, counts=counts)


def plan_suction_on_cloud(
    points: FloatArray,
    cup: SuctionCup,
    support: Support | None = None,
    viewpoints: FloatArray | None = None,
    options: SpatialOptions | None = None,
    neighbours: FloatArray | None = None,
) -> Proposals:
    """Plan places at which a cup takes the object that a cloud shows.

    A lip is put only on what was seen; where the hidden side can be completed, it tells where the
    weight acts and, without ``mass``, how much it is.

    Parameters
    ----------
    points : (n, 3), m
        Of one object, without its support.
    support
        In the frame of the points; None = it floats, and "up" is z.
    viewpoints : (k, 3) or None, m
        Where cameras were; None = seen from all around.
    neighbours : (m, 3) or None, m
        Points of what else stands there and must not be touched; None = nothing does.

    Returns
    -------
    Proposals
        As of :func:`plan_suction`.

    Examples
    --------
    >>> from grasp.spatial.meshes.shapes import box_mesh
    >>> box = box_mesh((0.1, 0.06, 0.04))
    >>> seen, faces = box.sample(6000, np.random.default_rng(0))
    >>> top = seen[box.normals[faces][:, 2] > 0.5]
    >>> camera = np.array([[0.0, 0.0, 0.5]])
    >>> best = plan_suction_on_cloud(top, SuctionCup("cup"), Support(-0.02), camera)[0]
    >>> [round(float(v)) for v in best.approach]
    [0, 0, -1]
    """
    options = options or SpatialOptions()
    table = None if support is None else support.plane
    # Without the support: what lies within two voxels of it, as a plate does, would be left out.
    cloud = prepare_cloud(points, viewpoints=viewpoints, flat=True)
    if cloud.reason:
        return Proposals(reason=cloud.reason, notes=cloud.notes)
    standing = prepare_cloud(points, table=table, viewpoints=viewpoints)
    whole = cloud if standing.reason else complete_by_symmetry(standing)
    surface, body = cloud.surface(), whole.surface()
    if not len(surface.faces):
        return Proposals(reason="no surface is seen of the object", notes=cloud.notes)
    load = ObjectLoad.of(body, options.mass, support)
    around = Surroundings(support, neighbours)
    proposals = _plan(replace(surface, com=body.com), cup, around, options, load)
    return replace(proposals, notes=(*whole.notes, *proposals.notes))


def _facing(points: FloatArray, normals: FloatArray, up: FloatArray) -> FloatArray:
    """Return poses (n, 4, 4) that approach points against their normals, x level."""
    level = np.cross(np.broadcast_to(up, normals.shape), normals)
    # On level faces any x will do.
    other = np.cross(normals, np.eye(3)[int(np.abs(up).argmin())])
    flat = np.linalg.norm(level, axis=1) < 1e-6
    x = np.where(flat[:, None], other, level)
    x /= np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-12)
    poses = np.tile(np.eye(4), (len(points), 1, 1))
    poses[:, :3, 0], poses[:, :3, 2], poses[:, :3, 3] = x, -normals, points
    poses[:, :3, 1] = np.cross(-normals, x)
    return poses


def _scored(
    candidates: list[GraspCandidate],
    mesh: Mesh,
    cup: SuctionCup,
    mass: float,
    up: FloatArray,
    options: SpatialOptions,
) -> list[GraspCandidate]:
    """Return the candidates with their scores under errors of the pose."""

    def judge(poses: FloatArray) -> Judged:
        return sealed(mesh, cup, poses), {
            name: _asked(cup, poses, mesh.com, mass, _loads(up, shaken))
            for name, shaken in (("lift", False), ("carry", True))
        }

    rated = []
    levers = _levers(np.stack([c.frame_from_gripper for c in candidates]), mesh.com)
    for candidate, lever in zip(candidates, levers.tolist(), strict=True):
        scored = scored_under_errors(candidate, options.noise, options.samples, options.seed, judge)
        rated.append(replace(scored, scores={**scored.scores, "lever": lever}))
    return rated
