"""One object as one camera saw it: decoded, described and measured."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rtask.rdf.terms import NamedNode

if TYPE_CHECKING:
    from features.geometry import Frame
    from features.recognition.views.view import ViewFeatures
    from features.tabletop import TabletopShape

__all__ = ["Observation"]


@dataclass(frozen=True)
class Observation:
    """One object as one camera saw it.

    Parameters
    ----------
    data
        As received; what the graph keeps. Of an image alone, its crop in the project's format.
    frame
        Decoded, in the optical frame of the camera; with an image of the object.
    features
        Described from ``frame``.
    frame_from_camera : (4, 4) float64, m
        Pose of the camera in the robot's frame ``frame_id``, z up.
    points : (n, 3) float64, m, ``frame_id``
        Of the object alone.
    shape
        Measured on its support; None when the points are too few to measure.
    frame_id
        Name of the robot's frame.
    stamp_s
        When it was taken, s since the epoch; None when the robot did not say.
    is_rendered
        The image was made from the cloud's own colours.
    is_posed
        The vertical is known; otherwise ``shape`` is measured in an arbitrary frame.
    object_pose : (4, 4) float64, m, or None
        Pose of the object in ``frame_id``, where another estimator found it.
    guess
        Class that the measured shape suggests and a confidence 0..1, or None. A guess about the
        kind of object, never a claim about which object it is.
    seconds
        ``decode_s`` and ``extraction_s``; zeros when it was decoded before.
    """

    data: bytes
    frame: Frame
    features: ViewFeatures
    frame_from_camera: NDArray[np.float64]
    points: NDArray[np.float64]
    shape: TabletopShape | None
    frame_id: str = ""
    stamp_s: float | None = None
    is_rendered: bool = False
    is_posed: bool = True
    guess: tuple[NamedNode, float] | None = None
    object_pose: NDArray[np.float64] | None = None
    seconds: dict[str, float] = field(default_factory=dict, compare=False)
