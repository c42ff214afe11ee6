"""Learners of grasps, compared on simulated outcomes."""
