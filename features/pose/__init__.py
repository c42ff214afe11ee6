"""Pose in six degrees of freedom of a recognised object, against its stored model."""

from features.pose.axis import AxisCheck, axis_check
from features.pose.confidence import PoseConfidence
from features.pose.estimate import PoseAlternative, PoseEstimate, PoseParams, estimate_pose
from features.pose.metrics import PoseError, pose_error
from features.pose.model import PoseModel, build_pose_model
from features.pose.views import estimate_pose_from_views

__all__ = [
    "AxisCheck",
    "PoseAlternative",
    "PoseConfidence",
    "PoseError",
    "PoseEstimate",
    "PoseModel",
    "PoseParams",
    "axis_check",
    "build_pose_model",
    "estimate_pose",
    "estimate_pose_from_views",
    "pose_error",
]
