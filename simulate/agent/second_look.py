"""Second look at an object, or for one that is out of sight, from another place than the first.

The head turns elsewhere; where the camera is fixed, another camera may see the object, such as the
one over a box, from which things on the near half of that side are in view.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
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

    @property
    def other_cameras(self) -> Sequence[str]: ...

    def look(self, side: str, camera: str | None = None) -> tuple[Frame, NDArray[np.float64]]: ...


class View(NamedTuple):
    """A frame, ``base_from_camera`` (4, 4), and what is perceived in it."""

    frame: Frame
    base_from_camera: NDArray[np.float64]
    perceived: Perceived


def seen_from_aside(eyes: Eyes, track: TrackedObject, side: str) -> dict[str, Any] | None:
    """Return an object as an observation from elsewhere; None if nothing else sees it whole.

    Parameters
    ----------
    side
        Where the head was turned for the first look.
    """
    sighting = _look_aside(eyes, track, side)
    if sighting is None:
        return None
    seen, view, base_from_camera = sighting
    return observation_message(seen, view, base_from_camera, eyes.base_frame)


def look_at_side(eyes: Eyes, tracker: Tracker, handled: TrackedObject | None, side: str) -> View:
    """Look at one side of the table and match what is there to the known objects.

    If the object just handled is not in view, the head turns elsewhere to look for it, and back.
    The first time, it turns to the other side as well: an arm may cross it on its way.

    Returns
    -------
    View
        Of the side, or the one from elsewhere that shows the object just handled.
    """
    sign = -1 if side == "right" else 1
    view = _view(eyes, side)
    tracker.update(_on_side(view, sign), handled, sign)
    if not tracker.has_seen(-sign):
        _glance(eyes, tracker, view, side)
    if handled is None or handled not in tracker.missing:
        return view
    for other in _views_aside(eyes, side, view.base_from_camera):
        if tracker.finds(handled, _on_side(other, sign), sign):
            view = other
            break
    eyes.look(side)
    return view


def _glance(eyes: Eyes, tracker: Tracker, view: View, side: str) -> None:
    """Note what stands on the other side of the table than the one that is looked at.

    It is not tracked yet: what stands in the middle may be seen on either side, and would be two.
    """
    other, sign = ("left", 1) if side == "right" else ("right", -1)
    frame, base_from_camera = eyes.look(other)
    if not np.allclose(base_from_camera, view.base_from_camera):  # else a fixed camera's
        seen = perceive(frame, base_from_camera, eyes.ignored)
        view = View(frame, base_from_camera, seen)
    tracker.note(_on_side(view, sign), sign)
    eyes.look(side)


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
    eyes: Eyes, track: TrackedObject, side: str
) -> tuple[Seen, Perceived, NDArray[np.float64]] | None:
    """Return an object as it looks with the head turned elsewhere, or from another camera.

    A view that cuts the object off says less of it than the first one did, and is passed over. The
    head turns back afterwards: what follows is planned in the view of that side.

    Returns
    -------
    tuple or None
        The object, the view that shows it, and base_from_camera (4, 4). None where nothing else
        shows it.
    """
    _, before = eyes.look(side)
    sighting = None
    for _, base_from_camera, view in chain(
        _views_aside(eyes, side, before), _views_of_others(eyes, side)
    ):
        seen = Tracker.same(track, view.objects)
        if seen is not None and not seen.touches_border:
            sighting = seen, view, base_from_camera
            break
    eyes.look(side)
    return sighting


def _views_of_others(eyes: Eyes, side: str) -> Iterator[View]:
    """Yield the views of the cameras that do not turn with the head."""
    for camera in eyes.other_cameras:
        frame, base_from_camera = eyes.look(side, camera)
        yield View(frame, base_from_camera, perceive(frame, base_from_camera, eyes.ignored))
