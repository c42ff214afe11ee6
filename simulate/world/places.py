"""Tables and boxes as a robot registers them: where they are in its base frame, and how large."""

from __future__ import annotations

from typing import Any

import numpy as np

from simulate.robots.description import Range
from simulate.world.world import PlaceBox, World

__all__ = ["box_message", "places_of", "surface_message"]


def places_of(world: World) -> list[dict[str, Any]]:
    """Return the table of a world and the boxes beside it; its frame is the robot's base frame.

    The names of the boxes are those under which robots report that they put something there.
    """
    if not np.isfinite(world.table_height):  # no table was added
        return []
    place = world.workplace
    table = surface_message("table", place.table_x, place.table_y, world.table_height)
    boxes = world.place_boxes.values()
    return [table, *(box_message(f"{box.side} box", box) for box in boxes)]


def box_message(name: str, box: PlaceBox) -> dict[str, Any]:
    """Return an open box, in the base frame of a robot."""
    return surface_message(name, box.x_range, box.y_range, box.floor, box.rim - box.floor)


def surface_message(
    name: str, x: Range, y: Range, height: float, rim_height: float = 0.0
) -> dict[str, Any]:
    """Return a level rectangle on which things stand.

    Parameters
    ----------
    x, y
        Ranges, m, in the base frame of the robot.
    height, rim_height
        Of the surface above the origin of that frame, and of the walls above the surface, m.
    """
    return {
        "name": name, "length": x[1] - x[0], "width": y[1] - y[0], "rim_height": rim_height,
        "pose": {
            "position": {"x": sum(x) / 2, "y": sum(y) / 2, "z": height},
            "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
        },
    }  # fmt: skip
