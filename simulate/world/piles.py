"""Things that touch: dropped onto the table and pushed together there, or shifted until they do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from simulate.world.world import World

__all__ = ["close_gaps", "drop", "touching_pairs"]

_FALL_M, _OFF_MIDDLE_M = 0.03, 0.04
_FIRST_HALF_M, _INWARDS_M_S = 0.12, 0.08
_PUSH_N = 8.0
_STEP_S, _REST_S = 0.05, 3.0
_STILL_M_S = 0.01
_WALL_M, _WALL_HEIGHT_M = 0.02, 0.5
_PARKED_M = -5.0
_TOUCH_M, _SHIFTS, _FAR_M = 0.0003, 60, 1.0


def drop(
    world: World,
    bodies: Sequence[int],
    rng: np.random.Generator,
    centre: tuple[float, float],
    half: float = 0.07,
) -> None:
    """Let things fall onto one place of the table, and push them together into a pile.

    Each falls in a random orientation once the one before is at rest. Four walls then move inwards
    until they bound a square of half side ``half`` or are resisted by 8 N, and vanish.

    Parameters
    ----------
    bodies
        In the world already, wherever they are.
    centre, half
        Middle and half side of the square, m.
    """
    client, floor = world.client, world.table_height
    for body in bodies:  # out of the way of those that fall before
        parked = (centre[0], centre[1], floor + _PARKED_M - body)
        client.resetBasePositionAndOrientation(body, parked, (0, 0, 0, 1))
    walls = {
        (dx, dy): world.add_wall(
            _wall_at(centre, floor, dx, dy, _FIRST_HALF_M), _wall_size(dx, _FIRST_HALF_M)
        )
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1))
    }
    top = floor
    for fallen, body in enumerate(bodies):
        turn = Rotation.random(random_state=rng).as_quat().tolist()
        at = np.array(centre) + rng.uniform(-_OFF_MIDDLE_M, _OFF_MIDDLE_M, 2)
        client.resetBasePositionAndOrientation(body, (*at, 0.0), turn)
        low, _ = client.getAABB(body)
        client.resetBasePositionAndOrientation(body, (*at, top + _FALL_M - low[2]), turn)
        client.resetBaseVelocity(body, (0, 0, 0), (0, 0, 0))
        _rest(world, bodies[: fallen + 1])
        top = max(client.getAABB(other)[1][2] for other in bodies[: fallen + 1])
    _push_together(world, walls, centre, half)
    for wall in walls.values():
        client.removeBody(wall)
    _rest(world, bodies)


def close_gaps(world: World, bodies: Sequence[int], centre: tuple[float, float]) -> None:
    """Shift things along the table until each touches another, the innermost first.

    Each goes as far as the nearest of those before it, and keeps its orientation.

    Parameters
    ----------
    bodies
        Standing apart on the table.
    centre
        Of the group, m; the thing nearest to it stays where it is.
    """
    client = world.client

    def away(body: int) -> float:
        pose = world.object_pose(body)
        return float(np.hypot(pose.x - centre[0], pose.y - centre[1]))

    def gap(body: int, other: int) -> float:
        points = client.getClosestPoints(body, other, _FAR_M)
        return min((float(point[8]) for point in points), default=_FAR_M)

    placed: list[int] = []
    for body in sorted(bodies, key=away):
        for _ in range(_SHIFTS if placed else 0):
            free, other = min((gap(body, one), one) for one in placed)
            if free < _TOUCH_M:
                break
            position, turn = client.getBasePositionAndOrientation(body)
            way = np.array(client.getBasePositionAndOrientation(other)[0][:2]) - position[:2]
            x, y = position[:2] + free * way / np.linalg.norm(way)
            client.resetBasePositionAndOrientation(body, (x, y, position[2]), turn)
        placed.append(body)
    _rest(world, bodies)


def touching_pairs(world: World, bodies: Sequence[int]) -> int:
    """Return how many pairs of things touch each other."""
    return sum(
        len(world.client.getContactPoints(a, b)) > 0
        for i, a in enumerate(bodies)
        for b in bodies[i + 1 :]
    )


def _push_together(
    world: World, walls: dict[tuple[int, int], int], centre: tuple[float, float], half: float
) -> None:
    """Move the walls inwards until they are resisted."""
    client, tick = world.client, 2 * world.preset.step_s
    reached = dict.fromkeys(walls, _FIRST_HALF_M)
    moving = set(walls)
    while moving:
        for side in list(moving):
            reached[side] -= _INWARDS_M_S * tick
            place = _wall_at(centre, world.table_height, *side, reached[side])
            client.resetBasePositionAndOrientation(walls[side], place, (0, 0, 0, 1))
        world.step(tick)
        for side in list(moving):
            force = sum(contact[9] for contact in client.getContactPoints(walls[side]))
            if reached[side] <= half or force > _PUSH_N:
                moving.remove(side)


def _wall_at(
    centre: tuple[float, float], floor: float, dx: int, dy: int, half: float
) -> tuple[float, float, float]:
    away = half + _WALL_M / 2
    return centre[0] + dx * away, centre[1] + dy * away, floor + 0.001 + _WALL_HEIGHT_M / 2


def _wall_size(dx: int, half: float) -> tuple[float, float, float]:
    along = 2 * (half + _WALL_M)
    return (_WALL_M, along, _WALL_HEIGHT_M) if dx else (along, _WALL_M, _WALL_HEIGHT_M)


def _rest(world: World, bodies: Sequence[int]) -> None:
    """Simulate until nothing moves, at most 3 s."""
    for _ in range(round(_REST_S / _STEP_S)):
        world.step(_STEP_S)
        speeds = [np.linalg.norm(world.client.getBaseVelocity(body)[0]) for body in bodies]
        if max(speeds) < _STILL_M_S:
            return
