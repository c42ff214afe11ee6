"""Grasp candidates, their robustness under uncertainty, and learning which one to take.

The room is numeric: arrays and small frozen dataclasses, no store, no HTTP, no global state.
"""
