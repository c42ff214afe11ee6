"""Comparison of planned grasps with a trivial sampler, by physics."""
