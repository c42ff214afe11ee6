"""Effort of a pose estimation, and what it answers."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from features.pose.confidence import PoseConfidence

__all__ = ["PoseAlternative", "PoseEstimate", "PoseParams"]


@dataclass(frozen=True)
class PoseParams:
    """Search effort and limits of the pose estimation.

    Parameters
    ----------
    starts, more_starts
        Rotations tried for the segment, and for the segment with neighbours; half as many for each
        half of it.
    keep
        Distinct poses of each that are refined.
    max_points
        Of a segment.
    recollected
        Best poses that collect the points the segmenter left out.
    merge
        Try neighbouring segments as parts of the object, and the object as half of the segment.
    near_m
        Points so near to a posed model may be collected, besides half a grid cell.
    enough_fit, max_violation
        A pose of the segment alone that is so good ends the search: what the segmenter left out
        would contradict a wrong one. Where the best pose fits less, halves of the segment are
        tried.
    penalty
        Of a contradiction with free space, in units of fit.
    doubt
        Where another pose's score is less below the best one's, both collect the points that the
        segmenter left out, and what they explain beside the segment counts.
    gain
        Of what a pose explains beside the segment, as a share of that and the segment, in units of
        fit.
    as_good
        A pose whose score is less below the best one's is as good.
    time_limit_s
        After so long no further hypothesis is begun.
    confidence
        Constants of the confidence.
    """

    starts: int = 256
    more_starts: int = 128
    keep: int = 24
    max_points: int = 1200
    recollected: int = 6
    merge: bool = True
    near_m: float = 0.007
    enough_fit: float = 0.6
    max_violation: float = 0.10
    penalty: float = 0.8
    doubt: float = 0.08
    gain: float = 1.0
    as_good: float = 0.03
    time_limit_s: float | None = None
    confidence: PoseConfidence = field(default_factory=PoseConfidence)


@dataclass(frozen=True, eq=False)
class PoseAlternative:
    """Another pose that explains the view.

    Parameters
    ----------
    camera_from_object : (4, 4) float64
    score
        On the scale of the best pose's; 1 = perfect.
    """

    camera_from_object: NDArray[np.float64]
    score: float


@dataclass(frozen=True, eq=False)
class PoseEstimate:
    """Estimated pose of an object, with its confidence.

    Parameters
    ----------
    camera_from_object : (4, 4) float64, m
        Of the frame that the model was given in.
    confidence
        Kehoe's s_T, 0..1.
    accepted
        Whether it reaches c_T. Below, the pose cannot be determined.
    fit, violation, coverage, explained
        How well the segment lies on the model; share of contradictions with free space; share of
        the visible side that was measured; share of the segment's points on the model.
    alternatives
        Distinct other poses, best first.
    ambiguous
        One of them is as good: no look from here can tell.
    symmetric_axes : (j, 3) float64
        Axes, in the object's frame, about which the turn means nothing.
    segments_used
        Labels of the segments that the object was taken to consist of.
    is_complete
        False when the time limit cut the search short.
    decided_by_colour
        Colours told this pose from those that a symmetry of the shape allows.
    is_turn_free
        The answer is ambiguous, but all poses as good put the surface where this one does, within
        some millimetres, as of an orange: how it is turned is not known, and another look tells no
        more. The confidence is that of any ambiguous answer.
    """

    camera_from_object: NDArray[np.float64]
    confidence: float
    accepted: bool
    fit: float
    violation: float
    coverage: float
    explained: float
    alternatives: tuple[PoseAlternative, ...]
    ambiguous: bool
    symmetric_axes: NDArray[np.float64]
    segments_used: tuple[int, ...]
    is_complete: bool = True
    decided_by_colour: bool = False
    is_turn_free: bool = False
