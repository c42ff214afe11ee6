"""Features stored in the graph beside image, cloud and keypoints (Gatto 2016, 3.2.2).

HOG, FPFH and the two B-splines as bytes, each with the numbers that describe it. The index of
recognition does not need them; whoever asks the graph for them does.
"""

from __future__ import annotations

import io
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from features.geometry import Frame
from features.recognition.views.view import ViewFeatures
from features.segmentation.fpfh import fpfh
from features.segmentation.voxels import build_voxels

__all__ = ["StoredFeature", "stored_features"]

_FPFH_VOXEL_M = 0.004
_DEGREE = 3


@dataclass(frozen=True)
class StoredFeature:
    """One visual feature.

    Parameters
    ----------
    kind
        Class in the ontology: ``HOGDescriptor``, ``FPFHFeatureSet``, ``BSplineContour`` or
        ``BSplineSurface``.
    data
        An ``.npz``.
    numbers
        Values of the ontology's properties of the same names.
    """

    kind: str
    data: bytes
    numbers: dict[str, Any] = field(default_factory=dict)


def stored_features(features: ViewFeatures, frame: Frame | None = None) -> list[StoredFeature]:
    """Return the features of a view that are stored one by one.

    Parameters
    ----------
    frame
        That the view was described from: gives FPFH, where it has depth.

    Examples
    --------
    >>> from features.recognition.views.view import describe_view
    >>> chess = ((np.indices((80, 80)) // 10).sum(axis=0) % 2 * 255).astype(np.uint8)
    >>> view = describe_view(np.pad(chess, 20), np.pad(chess >= 0, 20))
    >>> [feature.kind for feature in stored_features(view)]
    ['HOGDescriptor', 'BSplineContour']
    """
    collected = [
        StoredFeature(
            "HOGDescriptor",
            _npz(hog=features.hog.astype("<f4")),
            _descriptors(1, len(features.hog)),
        )
    ]
    points = None if frame is None else frame.points()[frame.object_mask()]
    if points is not None:
        finite = points[np.isfinite(points).all(axis=1)].astype(np.float64)
        if len(finite) >= 10:
            voxels = build_voxels(finite, None, _FPFH_VOXEL_M)
            histograms = fpfh(voxels).astype("<f4")
            collected.append(
                StoredFeature(
                    "FPFHFeatureSet",
                    _npz(fpfh=histograms, places_m=voxels.centroids.astype("<f4")),
                    _descriptors(*histograms.shape),
                )
            )
    if features.contour is not None:
        points_px = features.contour.control_points.astype("<f4")
        collected.append(
            StoredFeature(
                "BSplineContour",
                _npz(control_points_px=points_px),
                {"degree": _DEGREE, "controlPointCount": len(points_px)},
            )
        )
    if features.surface is not None:
        surface = features.surface
        collected.append(
            StoredFeature(
                "BSplineSurface",
                _npz(
                    coefficients_m=surface.coefficients.astype("<f4"), box=surface.box.astype("<f4")
                ),
                {
                    "degree": _DEGREE,
                    "controlPointCount": int(surface.coefficients.size),
                    "rmsResidual": float(surface.rms_m),
                },
            )
        )
    return collected


def _descriptors(count: int, length: int) -> dict[str, Any]:
    return {"descriptorCount": count, "descriptorLength": length, "elementType": "float32"}


def _npz(**arrays: Any) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()
