"""Comparison of two views of print: what agrees between them, and what does not."""
