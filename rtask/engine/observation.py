"""Observation of one object: decoded, described and measured."""

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
    """Observation of one object by a camera.

    Parameters
    ----------
    data
        Bytes as received, which the graph keeps. Of an image alone, its crop in the project's
        format.
    frame
        Decoded frame in the optical frame of the camera, with an image of the object.
    features
        Described from ``frame``.
    frame_from_camera : (4, 4) float64, m
        Pose of the camera in the robot's frame ``frame_id``, z up.
    points : (n, 3) float64, m, ``frame_id``
        Of the object alone.
    shape
        Measured on its support; None if there are too few points.
    frame_id
        Name of the robot's frame.
    stamp_s
        Time of the observation, s since the epoch; None if not given.
    is_rendered
        The image was rendered from the colours of the cloud.
    is_posed
        The vertical is known; otherwise ``shape`` is measured in an arbitrary frame.
    object_pose : (4, 4) float64, m, or None
        Pose of the object in ``frame_id``, where another estimator found it.
    guess
        Class that the measured shape suggests and a confidence 0..1, or None. It never
        identifies the object.
    seconds
        ``decode_s`` and ``extraction_s``; zero if it was already decoded.
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
