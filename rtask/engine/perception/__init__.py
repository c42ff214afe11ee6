"""Perception: observations decoded, identified and placed in the robot's frame."""
