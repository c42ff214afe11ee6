"""Upkeep of a graph: backups, comparison of derived data with their sources, rebuilding, counts."""
