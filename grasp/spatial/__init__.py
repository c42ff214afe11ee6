"""Grasps in space: grippers, frames, candidates on a tabletop."""
