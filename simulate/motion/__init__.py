"""Arm motion: kinematics, collision checks, paths and trajectories."""
