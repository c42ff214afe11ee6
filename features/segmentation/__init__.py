"""From a tabletop cloud to objects: plane, prism, supervoxels, convexity, merging."""

from features.segmentation.plane import Plane, find_table_plane
from features.segmentation.prism import Prism, table_prism
from features.segmentation.segment import (
    Scene,
    Segmentation,
    SegmentedObject,
    SegmentParams,
    segment_cloud,
    segment_scene,
    warm_up,
)

__all__ = [
    "Plane",
    "Prism",
    "Scene",
    "SegmentParams",
    "Segmentation",
    "SegmentedObject",
    "find_table_plane",
    "segment_cloud",
    "segment_scene",
    "table_prism",
    "warm_up",
]
