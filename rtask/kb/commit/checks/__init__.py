"""Checks of a pending change that need no reasoning."""
