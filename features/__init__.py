"""Perception: point clouds and images in, segments, descriptors, matches and poses out.

The room is numeric: arrays and small frozen dataclasses, IRIs as opaque strings, no store, no
HTTP, no global state.
"""
