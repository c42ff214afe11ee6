"""Second look at an object, from another place than the first."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from features.geometry import Frame
from features.perception import Ignored, Perceived, Seen, perceive
from simulate.agent.messages import observation_message
from simulate.agent.tracking import TrackedObject, Tracker

__all__ = ["asked_again"]

_ASIDE: Mapping[str, tuple[str, ...]] = {"right": ("ahead", "left"), "left": ("ahead", "right")}


class Eyes(Protocol):
    """The part of a body that looks; see :class:`simulate.agent.agent.Body`."""

    @property
    def base_frame(self) -> str: ...

    @property
    def ignored(self) -> tuple[Ignored, ...]: ...

    def look(self, side: str) -> tuple[Frame, NDArray[np.float64]]: ...


def asked_again(
    ask: Callable[..., dict[str, Any]],
    eyes: Eyes,
    thing: TrackedObject,
    side: str,
    request: dict[str, Any],
) -> dict[str, Any] | None:
    """Return the answer to a request with a second look at its object; None without one.

    Parameters
    ----------
    ask
        ``recognise_for_grasp`` of a server.
    side
        Where the head was turned for the first look.
    """
    found = _look_aside(eyes, thing, side)
    if found is None:
        return None
    seen, view, base_from_camera = found
    look = observation_message(seen, view, base_from_camera, eyes.base_frame)
    return ask(**request, looks=[look])


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
    for aside in _ASIDE[side]:
        frame, base_from_camera = eyes.look(aside)
        if np.allclose(base_from_camera, before):
            continue
        view = perceive(frame, base_from_camera, eyes.ignored)
        seen = Tracker.same(thing, view.objects)
        if seen is not None:
            found = seen, view, base_from_camera
            break
    eyes.look(side)
    return found
