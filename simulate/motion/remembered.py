"""Paths remembered: those that worked are first guesses for the next ones of the same arm.

After Lightning (Berenson, Abbeel and Goldberg 2012), which Kehoe 2014, 2.4 takes as the example of
learning motions in the cloud: planning anew and mending a recalled path run at once, and the first
valid path is taken. Here both take turns by the postures that they check, so that the same request
has the same answer on every machine. Unlike the sparse roadmaps of Thunder (Coleman et al. 2015)
and the graphs of E-Graphs (Phillips et al. 2012) paths are kept one by one, as each has an owner
who may withdraw it. A recalled path is a guess: all of it is checked in the present surroundings.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from simulate.motion.collision import ArmSpheres
from simulate.motion.rrt import IsFree, PlanOptions, edge_is_free, search, shortcut, trivial_path
from simulate.robots.description import Floats, RobotDescription

__all__ = ["PathMemory", "PathWork", "RememberedPath", "arm_version", "plan_with_memory"]

_Steps = Generator[tuple[Floats, str] | None]
"""None after each step, and at last a path with its origin, if there is one."""
_NEAREST = 3
"""Recalled paths that are tried, nearest first."""
_FARTHEST_RAD = 2.0
"""Largest movement of a joint between the ends of a path and those that are asked for: farther
ones are no better a guess than none."""
_SAME_RAD = 0.05
"""Largest movement of a joint between the ends of two paths that are not both worth keeping."""


@dataclass(frozen=True, eq=False)
class RememberedPath:
    """A path that an arm has followed.

    Parameters
    ----------
    corners : (k, dof) float, rad
        k >= 3; straight ways need no memory.
    name
        IRI in the graph; empty for one that is not stored yet.
    """

    corners: Floats
    name: str = ""


@dataclass
class PathWork:
    """Work of a memory so far, and what came of it.

    Parameters
    ----------
    checks
        Postures checked for collisions while searching, both ways together.
    of_first
        Those of the way that was first, alone: how long it takes on two processors at once.
    shortening
        Postures checked while shortening.
    origins
        Number of paths by origin: ``straight``, ``planned``, ``recalled`` or ``mended``.
    """

    checks: int = 0
    of_first: int = 0
    shortening: int = 0
    origins: dict[str, int] = field(default_factory=dict)


@dataclass(eq=False)
class PathMemory:
    """Paths of the arms of one body, by the versions of these arms.

    Parameters
    ----------
    paths
        Remembered so far, by version (:func:`arm_version`).
    recalls
        Whether paths are recalled; if not, all are planned anew, with the same bookkeeping.
    """

    paths: dict[str, list[RememberedPath]] = field(default_factory=dict)
    recalls: bool = True
    work: PathWork = field(default_factory=PathWork)
    new: list[tuple[str, RememberedPath]] = field(default_factory=list)
    """Versions of arms and paths found since, that no remembered one resembles."""

    def add(self, version: str, path: RememberedPath) -> bool:
        """Remember a path, unless it is straight or resembles one; return whether it is kept."""
        known = self.paths.setdefault(version, [])
        if len(path.corners) < 3 or any(_is_alike(path, other) for other in known):
            return False
        known.append(path)
        return True

    def nearest(self, version: str, start: Floats, goal: Floats) -> list[Floats]:
        """Return inner corners (k, dof) of the paths whose ends are nearest, nearest first.

        Paths lead both ways.
        """
        ranked: list[tuple[float, int, Floats]] = []
        for number, path in enumerate(self.paths.get(version, ())):
            if path.corners.shape[1] != len(start):
                continue
            for corners in (path.corners, path.corners[::-1]):
                ends = np.abs(corners[[0, -1]] - np.stack([start, goal])).max(axis=1)
                if ends.max() <= _FARTHEST_RAD:
                    ranked.append((float(ends.sum()), number, corners[1:-1]))
        ranked.sort(key=lambda row: row[:2])
        return [inner for _, _, inner in ranked[:_NEAREST]]

    def plan(
        self,
        version: str,
        ends: tuple[Floats, Floats],
        limits: tuple[Floats, Floats],
        is_free: IsFree,
        rng: np.random.Generator,
    ) -> Floats | str:
        """Return a path as :func:`simulate.motion.rrt.plan_path` does, and remember it."""
        recalled = self.nearest(version, *ends) if self.recalls else []
        corners = plan_with_memory(ends, limits, is_free, rng, recalled, self.work)
        if not isinstance(corners, str):
            path = RememberedPath(corners)
            if self.add(version, path):
                self.new.append((version, path))
        return corners


def arm_version(robot: RobotDescription, arm: str, spheres: ArmSpheres) -> str:
    """Return the digest of everything about a body on which the paths of an arm depend.

    Two bodies with equal digests have the same joints, limits and shapes, so that what one has
    learned holds for the other; any change of the body makes another version.
    """
    chain = spheres.chain
    digest = hashlib.sha256(f"{arm} {chain.names} {chain.links} {robot.name}".encode())
    postures = np.stack([chain.lower, (chain.lower + chain.upper) / 2, chain.upper])
    rotations, positions = chain.link_frames(postures)
    empty = spheres.group != "load"
    for values in (chain.lower, chain.upper, chain.velocity, rotations, positions,
                   spheres.link[empty], spheres.centres[empty], spheres.radii[empty]):  # fmt: skip
        # Rounded, because sums of floating-point numbers differ between machines.
        digest.update(np.round(np.asarray(values, dtype=np.float64), 6).tobytes())
    return digest.hexdigest()[:32]


class _Counted:
    """A check of collisions that counts the postures it was asked about."""

    def __init__(self, is_free: IsFree) -> None:
        self._is_free = is_free
        self.count = 0

    def __call__(self, postures: Floats) -> NDArray[np.bool_]:
        self.count += len(postures)
        return self._is_free(postures)


def plan_with_memory(
    ends: tuple[Floats, Floats],
    limits: tuple[Floats, Floats],
    is_free: IsFree,
    rng: np.random.Generator,
    recalled: Sequence[Floats],
    work: PathWork,
    options: PlanOptions | None = None,
) -> Floats | str:
    """Plan a path anew and mend recalled ones by turns; return the first that is valid.

    Parameters
    ----------
    ends : two (dof,) float, rad
        Start and goal.
    limits : two (dof,) float, rad
        Lower and upper joint limits.
    is_free
        Collision check of a batch of postures.
    rng
        Source of samples.
    recalled : of (k, dof) float, rad
        Inner corners of remembered paths, the likeliest first.
    work
        Is counted up.

    Returns
    -------
    (k, dof) float or str
        The corners of the path, or a reason code as of ``plan_path``.
    """
    options = options or PlanOptions()
    anew, again, after = (_Counted(is_free) for _ in range(3))
    path = trivial_path(*ends, anew, options)
    origin, straight = "straight", anew.count
    if path is None:
        guesses = _recall(ends, limits, recalled, again, rng.spawn(1)[0], options)
        ways = {"again": guesses, "anew": _anew(search(*ends, *limits, anew, rng, options))}
        counts = {"again": lambda: again.count, "anew": lambda: anew.count - straight}
        path, origin = _first(ways, counts)
    if not isinstance(path, str):
        path = shortcut(path, after, rng, options)
        work.origins[origin] = work.origins.get(origin, 0) + 1
    work.checks += anew.count + again.count
    of_winner = {"planned": anew.count, "straight": straight}.get(origin, straight + again.count)
    work.of_first += of_winner if origin else anew.count
    work.shortening += after.count
    return path


def _first(
    ways: dict[str, _Steps], counts: Mapping[str, Callable[[], int]]
) -> tuple[Floats | str, str]:
    """Let both take turns, who has checked less first; return the first path and its origin."""
    while ways:
        name = min(ways, key=lambda way: counts[way]())
        try:
            found = next(ways[name])
        except StopIteration:
            del ways[name]
            continue
        if found is not None:
            return found
    return "rrt_time", ""


def _anew(steps: Generator[Floats | None]) -> _Steps:
    for path in steps:
        yield None if path is None else (path, "planned")


def _recall(
    ends: tuple[Floats, Floats],
    limits: tuple[Floats, Floats],
    recalled: Sequence[Floats],
    is_free: IsFree,
    rng: np.random.Generator,
    options: PlanOptions,
) -> _Steps:
    """Fit recalled paths to new ends: the first that is free, else the least blocked one mended."""
    fitted: list[tuple[int, Floats, list[int]]] = []
    for inner in recalled:
        corners = np.stack([ends[0], *inner[is_free(inner)], ends[1]])
        blocked = []
        for number, (a, b) in enumerate(pairwise(corners)):
            yield None
            if not edge_is_free(a, b, is_free, options.resolution):
                blocked.append(number)
        if not blocked:
            yield corners, "recalled"
            return
        fitted.append((len(blocked), corners, blocked))
    for _, corners, blocked in sorted(fitted, key=lambda row: row[0]):
        parts = []
        for number, (a, b) in enumerate(pairwise(corners)):
            part = np.stack([a, b]) if number not in blocked else None
            if part is None:
                for grown in search(a, b, *limits, is_free, rng, options):
                    part = grown
                    yield None
            if part is None:
                break
            parts.append(part)
        else:
            yield np.concatenate([parts[0], *(part[1:] for part in parts[1:])]), "mended"
            return


def _is_alike(one: RememberedPath, other: RememberedPath) -> bool:
    """Whether the ends of two paths are nearly the same, in one direction or the other."""
    ends = one.corners[[0, -1]]
    return any(
        bool(np.abs(ends - there).max() < _SAME_RAD)
        for there in (other.corners[[0, -1]], other.corners[[-1, 0]])
        if ends.shape == there.shape
    )
