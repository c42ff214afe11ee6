"""Scenes: one tree of frames at an instant, with robots, things and grasps, for other programs.

:func:`read_scene` takes it from the graph; :func:`glb` and :func:`usda` write it as binary glTF 2.0
and as OpenUSD text.
"""

from __future__ import annotations

from rtask.world.scene.glb import glb
from rtask.world.scene.nodes import Scene, SceneNode, SceneSurface, Unplaced
from rtask.world.scene.reading import read_scene
from rtask.world.scene.usda import usda

__all__ = ["FORMATS", "Scene", "SceneNode", "SceneSurface", "Unplaced", "glb", "read_scene", "usda"]

FORMATS = {"glb": "model/gltf-binary", "usda": "model/vnd.usda"}
"""Media type of each format, by the suffix of its files."""
