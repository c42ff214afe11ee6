"""Branches: copies of a graph by hard links that are written, compared and merged, or dropped."""
