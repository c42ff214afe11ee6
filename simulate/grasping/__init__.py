"""Grasp planning and execution with a robot's arm."""
