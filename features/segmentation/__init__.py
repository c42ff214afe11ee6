"""From a tabletop cloud to objects: plane, prism, supervoxels, convexity, merging."""

from features.segmentation.metrics import SegmentationScore, score_labels
from features.segmentation.plane import Plane, find_table_plane
from features.segmentation.prism import Prism, table_prism
from features.segmentation.scene import Scene, SegmentedObject, segment_scene, warm_up
from features.segmentation.segment import Segmentation, SegmentParams, segment_cloud
from features.segmentation.several import PlacedView, SeveralViews, placed_frame, segment_views

__all__ = [
    "PlacedView",
    "Plane",
    "Prism",
    "Scene",
    "SegmentParams",
    "Segmentation",
    "SegmentationScore",
    "SegmentedObject",
    "SeveralViews",
    "find_table_plane",
    "placed_frame",
    "score_labels",
    "segment_cloud",
    "segment_scene",
    "segment_views",
    "table_prism",
    "warm_up",
]
