"""Things as robots see them in an area, and which of them is a thing that is looked for.

The graph recognises a side that it knows. What was put down anew, or fell over, may show another
one: then its size tells, as long as nothing else that is expected there has that size.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from features.perception import Seen
from simulate.agent.second_look import View

__all__ = ["Sighting", "disambiguated", "find_by_size", "size_of"]

_SAME_SIZE = 0.35
"""Of a thing that lies another way than it stood, a camera sees its sizes by so much otherwise."""


@dataclass(frozen=True)
class Sighting:
    """A thing as it was seen in an area.

    Parameters
    ----------
    seen, view
        The thing, and the view that shows it.
    object
        IRI of its product; empty if it was not recognised.
    observation
        The view of it as a message.
    likeness
        Confidence that it is of this product, above 1 if the graph accepts it as that.
    """

    seen: Seen
    view: View
    object: str
    observation: dict[str, Any]
    likeness: float = 0.0

    @property
    def is_accepted(self) -> bool:
        """Whether the graph is sure of its product."""
        return self.likeness > 1


def disambiguated(sightings: list[Sighting]) -> list[Sighting]:
    """Return what one view shows, where of things that resemble a product only the likest is it.

    A can beside a box that resembles this can would else be picked up as the can, or the box would.
    """
    best = {s.object: s for s in sorted(sightings, key=lambda s: s.likeness)}
    return [s if s.is_accepted or s is best[s.object] else replace(s, object="") for s in sightings]


def size_of(sighting: Sighting) -> list[float]:
    """Return the sizes of a thing as it was seen, m, the smallest first."""
    shape = sighting.seen.shape
    return sorted((shape.length, shape.width, shape.height))


def find_by_size(
    there: Iterable[Sighting], size: Sequence[float], missing: Iterable[Sequence[float]] = ()
) -> Sighting | None:
    """Return what is not recognised in a view and can only be a thing of a size; None for nothing.

    Parameters
    ----------
    there
        What one view shows of an area.
    size : (3,) float, m
        Of the thing, the smallest first.
    missing
        Sizes of other things that are expected there, and that the view does not show either.
    """
    alike = [s for s in there if not s.object and _is_alike(size_of(s), size)]
    if len(alike) != 1:
        return None
    # One stranger for two missing things of a size: to pick it up as either would be a guess.
    if any(_is_alike(size_of(alike[0]), other) for other in missing):
        return None
    return alike[0]


def _is_alike(seen: Sequence[float], size: Sequence[float]) -> bool:
    return bool(np.all(np.abs(np.array(seen) / size - 1) < _SAME_SIZE))
