"""Pose in six degrees of freedom of a recognised object, against its stored model."""

from features.pose.confidence import PoseConfidence
from features.pose.estimate import PoseAlternative, PoseEstimate, PoseParams, estimate_pose
from features.pose.metrics import PoseError, pose_error
from features.pose.model import PoseModel, build_pose_model

__all__ = [
    "PoseAlternative",
    "PoseConfidence",
    "PoseError",
    "PoseEstimate",
    "PoseModel",
    "PoseParams",
    "build_pose_model",
    "estimate_pose",
    "pose_error",
]
