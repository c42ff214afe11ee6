"""Hands whose three fingers close on a common axis."""
