"""Checks of a robot's file: what cannot be meant as it is written is named before any work."""
