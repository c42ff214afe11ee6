"""Second look at an object, or for one that is out of sight, from another place than the first."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from features.geometry import Frame
from features.perception import Ignored, Perceived, Seen, perceive
from simulate.agent.messages import observation_message
from simulate.agent.tracking import TrackedObject, Tracker

__all__ = ["View", "look_at_side", "seen_from_aside"]

_ASIDE: Mapping[str, tuple[str, ...]] = {"right": ("ahead", "left"), "left": ("ahead", "right")}


class Eyes(Protocol):
    """The part of a body that looks; see :class:`simulate.agent.interfaces.Body`."""

    @property
    def base_frame(self) -> str: ...

    @property
    def ignored(self) -> tuple[Ignored, ...]: ...

    def look(self, side: str) -> tuple[Frame, NDArray[np.float64]]: ...


class View(NamedTuple):
    """A frame, ``base_from_camera`` (4, 4), and what is perceived in it."""

    frame: Frame
    base_from_camera: NDArray[np.float64]
    perceived: Perceived


def seen_from_aside(eyes: Eyes, thing: TrackedObject, side: str) -> dict[str, Any] | None:
    """Return an object as an observation with the head turned elsewhere; None if that fails.

    Parameters
    ----------
    side
        Where the head was turned for the first look.
    """
    found = _look_aside(eyes, thing, side)
    if found is None:
        return None
    seen, view, base_from_camera = found
    return observation_message(seen, view, base_from_camera, eyes.base_frame)


def look_at_side(eyes: Eyes, tracker: Tracker, handled: TrackedObject | None, side: str) -> View:
    """Look at one side of the table and match what is there to the known objects.

    If the object just handled is not in view, the head turns elsewhere to look for it, and back.

    Returns
    -------
    View
        Of the side, or the one from elsewhere that shows the object just handled.
    """
    sign = -1 if side == "right" else 1
    view = _view(eyes, side)
    tracker.update(_on_side(view, sign), handled, sign)
    if handled is None or handled not in tracker.missing:
        return view
    for other in _views_aside(eyes, side, view.base_from_camera):
        if tracker.finds(handled, _on_side(other, sign), sign):
            view = other
            break
    eyes.look(side)
    return view


def _view(eyes: Eyes, side: str) -> View:
    frame, base_from_camera = eyes.look(side)
    return View(frame, base_from_camera, perceive(frame, base_from_camera, eyes.ignored))


def _views_aside(eyes: Eyes, side: str, before: NDArray[np.float64]) -> Iterator[View]:
    """Yield views with the head turned elsewhere; none where the camera is fixed."""
    for aside in _ASIDE[side]:
        frame, base_from_camera = eyes.look(aside)
        if not np.allclose(base_from_camera, before):
            seen = perceive(frame, base_from_camera, eyes.ignored)
            yield View(frame, base_from_camera, seen)


def _on_side(view: View, sign: int) -> list[Seen]:
    return [seen for seen in view.perceived.objects if seen.position[1] * sign >= 0]


def _look_aside(
    eyes: Eyes, thing: TrackedObject, side: str
) -> tuple[Seen, Perceived, NDArray[np.float64]] | None:
    """Return an object as it looks with the head turned elsewhere.

    The head turns back afterwards: what follows is planned in the view of that side.

    Returns
    -------
    tuple or None
        The object, the view that shows it, and base_from_camera (4, 4). None where the camera is
        fixed, or shows nothing at the object's place.
    """
    _, before = eyes.look(side)
    found = None
    for _, base_from_camera, view in _views_aside(eyes, side, before):
        seen = Tracker.same(thing, view.objects)
        if seen is not None:
            found = seen, view, base_from_camera
            break
    eyes.look(side)
    return found
