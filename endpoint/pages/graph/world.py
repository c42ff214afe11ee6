"""Page of the world: rooms, tables, robots and things at a time, drawn and as a list.

The same scene is served as glTF and OpenUSD, for programs that draw or simulate it.
"""

from __future__ import annotations

import datetime as dt
import time
from collections import Counter
from dataclasses import asdict, dataclass
from typing import Any

import flask
import numpy as np
from werkzeug.wrappers import Response as WerkzeugResponse

from endpoint.pages.render import Model, blueprint, embedded_graph, page, query
from rtask.errors import RtaskError, UsageError
from rtask.rdf.terms import moment
from rtask.world import World, world_of
from rtask.world.scene import FORMATS, Scene, SceneNode, glb, usda

__all__ = ["world"]

_ADDRESS = "/world"
_DRAWN_GRASPS = 0
_MAX_SHOWN = 200
_BEYOND = 0.03
_MAX_AHEAD_S = 365 * 86_400.0
"""Of a time that is asked about, so that its calendar date can be computed."""


@dataclass(frozen=True)
class _Asked:
    """The time, Unix, s, and the frame in the address; "" for the tree with most things."""

    time_s: float
    frame: str
    is_now: bool


@page(_ADDRESS, "world.html")
def world() -> Model:
    """Return what is where at the time in the address, or what was wrong with it."""
    model: Model = {
        "at": flask.request.args.get("at", "").strip(), "problem": "", "scene": None, "span": None,
        "frame": flask.request.args.get("frame", "").strip(), "formats": list(FORMATS),
    }  # fmt: skip
    shown = world_of(embedded_graph())
    try:
        asked = _asked()
        scene = shown.scene(asked.time_s, asked.frame or None, _DRAWN_GRASPS, surfaces=False)
    except RtaskError as error:
        return {**model, "problem": str(error)}
    span = shown.index.moments(asked.time_s)
    if span is not None:
        # A little beyond the last change, so that what it left can be slid to; not up to now, or
        # the changes of a morning would all lie under one pixel of the slider a month later.
        beyond_s = max(_BEYOND * (span.last_s - span.first_s), 1.0)
        model["span"] = {**span._asdict(), "end_s": span.last_s + beyond_s}
        model["span"] |= {
            name: None if at is None else _stamp(at)
            for name, at in (
                ("first", span.first_s),
                ("last", span.last_s),
                ("before", span.before_s),
                ("after", span.after_s),
            )
        }
    return {**model, "scene": _shown(shown, scene), "is_now": asked.is_now,
            "exports": _exports(model["at"], asked.frame)}  # fmt: skip


@blueprint.route(f"{_ADDRESS}/scene.<suffix>", methods=["GET"])
def world_scene(suffix: str) -> WerkzeugResponse:
    """Return the scene at a time as glTF or OpenUSD."""
    if suffix not in FORMATS:
        raise UsageError(f"scene.{suffix}: expected scene.{' or scene.'.join(FORMATS)}")
    asked = _asked()
    scene = world_of(embedded_graph()).scene(asked.time_s, asked.frame or None)
    data = glb(scene) if suffix == "glb" else usda(scene).encode()
    response = flask.Response(data, content_type=FORMATS[suffix])
    response.headers["Cache-Control"] = "private, no-cache"
    response.headers["Content-Disposition"] = f'attachment; filename="scene.{suffix}"'
    return response


def _asked() -> _Asked:
    """Return what the address asks for.

    Raises
    ------
    UsageError
        The time is none.
    """
    given = flask.request.args
    text, now_s = given.get("at", "").strip(), time.time()
    if not text:
        return _Asked(now_s, given.get("frame", "").strip(), True)
    time_s = _seconds(text)
    if not 0.0 <= time_s <= now_s + _MAX_AHEAD_S:
        raise UsageError(
            f"at={text[:40]}: expected a time from 1970 to a year from now", field="at"
        )
    return _Asked(time_s, given.get("frame", "").strip(), False)


def _seconds(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return moment(text).timestamp()


def _exports(at: str, frame: str) -> dict[str, str]:
    given = {"at": at, "frame": frame}
    return {suffix: query(given, f"{_ADDRESS}/scene.{suffix}").rstrip("?") for suffix in FORMATS}


def _shown(world: World, scene: Scene) -> Model:
    """Return a scene with poses in its root, for the drawing and the list."""
    nodes = [
        _node(scene, node, pose) for node, pose in zip(scene.nodes, scene.root_from_nodes(),
                                                       strict=True)
    ]  # fmt: skip
    counts = Counter(node.kind for node in scene.nodes)
    return {
        "time": _stamp(scene.time_s), "time_s": scene.time_s, "root": scene.root,
        "root_name": _full_name(world, scene.root), "nodes": nodes, "counts": dict(counts),
        "others": [
            {"iri": root, "name": world.frames.name_of(root), "robot": _robot_of(root),
             "things": things}
            for root, things in scene.other_roots
        ],
        "unplaced": [asdict(one) for one in scene.unplaced[:_MAX_SHOWN]],
        "more_unplaced": max(0, len(scene.unplaced) - _MAX_SHOWN),
    }  # fmt: skip


def _node(scene: Scene, node: SceneNode, root_from_node: Any) -> Model:
    facts = dict(node.facts)
    for name in ("since", "seen"):
        if name in facts:
            facts[name] = _stamp(float(facts[name]))
    return {
        "kind": node.kind, "iri": node.iri, "label": node.label, "parent": node.parent,
        "above": scene.nodes[node.parent].label if node.parent is not None else "",
        "pose": np.round(root_from_node, 5).tolist(), "size": node.size_m,
        "region": node.region_m, **facts,
    }  # fmt: skip


def _full_name(world: World, frame: str) -> str:
    """Return the name of a frame, behind that of its robot: each has a frame of such a name."""
    name, robot = world.frames.name_of(frame), _robot_of(frame)
    return f"{robot}/{name}" if robot else name


def _robot_of(frame: str) -> str:
    """Return the last part of the IRI of the robot to which a frame belongs, or ""."""
    robot, located, _ = frame.rpartition("/frame/")
    return robot.rpartition("/")[2] if located and "/robot/" in robot else ""


def _stamp(time_s: float) -> str:
    """Return a time as ISO 8601 in UTC, to the millisecond, rounded to no earlier than it was."""
    at = dt.datetime.fromtimestamp(np.ceil(time_s * 1000) / 1000, dt.UTC)
    return at.isoformat(timespec="milliseconds").replace("+00:00", "Z")
