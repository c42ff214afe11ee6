"""Robots as data: published facts, descriptions built from them, and the URDF text."""

from __future__ import annotations

from simulate.robots.description import Arm, CameraMount, Joint, Link, RobotDescription, Shape
from simulate.robots.nao import describe_nao
from simulate.robots.urdf import urdf_text

__all__ = [
    "Arm",
    "CameraMount",
    "Joint",
    "Link",
    "RobotDescription",
    "Shape",
    "describe_nao",
    "urdf_text",
]
