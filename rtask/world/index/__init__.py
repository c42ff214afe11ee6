"""Index of placements by thing and time; see :class:`PlacementIndex`."""

from __future__ import annotations

from rtask.world.index.sorted import Moments, PlacementIndex

__all__ = ["Moments", "PlacementIndex"]
