"""Answers of services as people read them: tables, pictures, clouds, poses, curves.

What a value is follows from the types that its method declares, and from the first bytes of files.
"""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from endpoint.pages.clouds import coloured_points, ply_of, thinned
from endpoint.pages.drawn import has_viewer
from endpoint.pages.render import Model, blob_url
from rtask.wire.message import Answer

__all__ = ["shown_answer"]

MAX_CLOUD_POINTS = 4000
MAX_ROWS = 200
MAX_DRAWN = 100
_DIGEST = re.compile("[0-9a-f]{64}")
_PICTURES = {b"\x89PNG": "image/png", b"\xff\xd8\xff": "image/jpeg", b"RIFF": "image/webp"}


class _Shown:
    """Findings in an answer so far."""

    def __init__(self) -> None:
        self.facts: list[Model] = []
        self.tables: list[Model] = []
        self.clouds: list[Model] = []
        self.poses: list[Model] = []
        self.curves: list[Model] = []
        self.poses_left_out = 0

    def cell(self, name: str, value: Any) -> Model:
        """Return one value as text or a picture; clouds and poses are kept to be drawn too."""
        if isinstance(value, bytes):
            return self._file(name, value)
        if isinstance(value, str) and name.endswith("picture") and _DIGEST.fullmatch(value):
            return {"image": blob_url(value), "text": name}
        pose = _pose_message(value)
        if pose is not None:
            if len(self.poses) < MAX_DRAWN:
                self.poses.append({"name": name, "pose": pose})
            else:
                self.poses_left_out += 1
            return {"text": _pose_words(pose)}
        return {"text": _words(value)}

    def _file(self, name: str, data: bytes) -> Model:
        kind = next((kind for magic, kind in _PICTURES.items() if data.startswith(magic)), "")
        if kind:
            return {"image": f"data:{kind};base64,{base64.b64encode(data).decode()}", "text": name}
        cloud = _cloud(data)
        if cloud is None:
            return {"text": f"{len(data)} bytes"}
        self.clouds.append({"name": name, "ply": base64.b64encode(cloud[0]).decode()})
        return {"text": f"a cloud of {cloud[1]} points, drawn below as “{name}”"}

    def table(self, name: str, rows: Sequence[Mapping[str, Any]]) -> None:
        """Add a list of messages of the same kind."""
        columns = list(dict.fromkeys(key for row in rows for key in row))
        cells = [
            [self.cell(f"{name} {number}, {key}", row.get(key)) for key in columns]
            for number, row in enumerate(rows[:MAX_ROWS], 1)
        ]
        self.tables.append({"name": name, "columns": columns, "rows": cells, "count": len(rows)})

    def add(self, name: str, value: Any) -> None:
        """Add a field of an answer, as whatever shows it best."""
        if isinstance(value, BaseModel):
            value = _fields(value)
        if isinstance(value, Mapping) and _pose_message(value) is None and value:
            for key, part in value.items():
                self.add(f"{name} {key}".strip(), part)
        elif _is_list_of_messages(value):
            self.table(name, [_fields(row) for row in value])
        elif (numbers := _matrix(value)) is not None:
            columns = [str(k + 1) for k in range(numbers.shape[1])]
            rows = [dict(zip(columns, row, strict=True)) for row in numbers.tolist()]
            self.table(name, rows)
            values = zip(columns, numbers[:MAX_ROWS].T.tolist(), strict=True)
            lines = [{"name": column, "values": line} for column, line in values]
            self.curves.append({"name": name, "lines": lines})
        else:
            self.facts.append({"name": name, **self.cell(name, value)})


def shown_answer(answer: Answer, request: Mapping[str, Any]) -> Model:
    """Return the parts of an answer that a page shows.

    Parameters
    ----------
    request
        What was asked; planar grasps are drawn on the outline in it.
    """
    shown = _Shown()
    for name, value in _fields(answer).items():
        shown.add(name.replace("_", " "), value)
    return {
        "facts": shown.facts,
        "tables": shown.tables,
        "clouds": shown.clouds,
        "poses": shown.poses,
        "poses_left_out": shown.poses_left_out,
        "curves": shown.curves,
        "outline": _outline(answer, request),
        "has_viewer": has_viewer(),
        "text": json.dumps(answer.as_json(), indent=2, ensure_ascii=False),
    }


def _fields(value: Any) -> dict[str, Any]:
    if not isinstance(value, BaseModel):
        return dict(value)
    return {name: getattr(value, name) for name in type(value).model_fields
            if name in value.model_fields_set}  # fmt: skip


def _is_list_of_messages(value: Any) -> bool:
    return (
        isinstance(value, list)
        and bool(value)
        and all(isinstance(item, BaseModel | Mapping) for item in value)
        and _pose_message(value[0]) is None
    )


def _matrix(value: Any) -> NDArray[np.float64] | None:
    """Return numbers in rows of the same length, of which there are several, as a table."""
    if not isinstance(value, list | np.ndarray) or len(value) < 2:
        return None
    try:
        numbers = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        return None
    return numbers if numbers.ndim == 2 and numbers.shape != (4, 4) else None


def _pose_message(value: Any) -> Model | None:
    """Return a value as geometry_msgs/Pose if it is a pose, stamped or not."""
    from grasp.messages import pose_message

    if isinstance(value, np.ndarray):
        return pose_message(value) if value.shape == (4, 4) else None
    if isinstance(value, BaseModel):
        value = _fields(value)
    if not isinstance(value, Mapping):
        return None
    if {"header", "pose"} <= value.keys():
        return _pose_message(value["pose"])
    return dict(value) if value.keys() == {"position", "orientation"} else None


def _pose_words(pose: Model) -> str:
    at, turned = pose["position"], pose["orientation"]
    return (
        f"at {', '.join(_number(at[axis]) for axis in 'xyz')} m, "
        f"turned {', '.join(_number(turned[axis]) for axis in 'xyzw')}"
    )


def _words(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, float | np.floating):
        return _number(float(value))
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, list):
        return ", ".join(_words(item) for item in value) if value else "none"
    if isinstance(value, BaseModel):
        value = value.model_dump(by_alias=True, exclude_unset=True)
    if isinstance(value, Mapping):
        return json.dumps(value, ensure_ascii=False, default=str)
    return str(value)


def _number(value: float) -> str:
    return f"{value:.4g}"


def _cloud(data: bytes) -> tuple[bytes, int] | None:
    """Return a cloud or depth image as PLY of few points, and how many it has; else None."""
    try:
        points, colours = coloured_points(data)
    except ValueError:
        return None
    few = thinned(points, colours, MAX_CLOUD_POINTS)
    return ply_of(*few), len(points)


def _outline(answer: Answer, request: Mapping[str, Any]) -> str:
    """Return the SVG of planar grasps on the outline of their part; empty for other answers."""
    grasps = _fields(answer).get("grasps")
    part = request.get("polygon")
    if not isinstance(grasps, list) or part is None:
        return ""
    rows = [_fields(grasp) for grasp in grasps]
    if not rows or not {"contact", "whisker_end", "probability"} <= rows[0].keys():
        return ""
    vertices = np.asarray(part, np.float64)
    whiskers = np.array([[row["contact"], row["whisker_end"]] for row in rows])
    every = np.concatenate([vertices, whiskers.reshape(-1, 2)])
    low, size = every.min(axis=0), np.ptp(every, axis=0)
    scale = 300 / max(float(size.max()), 1e-9)

    def at(point: NDArray[np.float64]) -> tuple[float, float]:
        x, y = (point - low) * scale + 20
        return float(x), float(size[1] * scale + 40 - y)

    return _svg(vertices, whiskers, at, (size * scale + 40).tolist())


def _svg(
    vertices: NDArray[np.float64],
    whiskers: NDArray[np.float64],
    at: Callable[[NDArray[np.float64]], tuple[float, float]],
    size: list[float],
) -> str:
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in map(at, vertices))
    lines = []
    for number, (start, end) in enumerate(whiskers):
        (x1, y1), (x2, y2) = at(start), at(end)
        look = "whisker best" if number == 0 else "whisker"
        lines.append(
            f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" class="{look}"/>'
        )
    return (
        f'<svg class="outline drawn" viewBox="0 0 {size[0]:.0f} {size[1]:.0f}" role="img" '
        'aria-label="The part and its grasps as whiskers">'
        f'<polygon points="{points}" class="part"/>'
        f"{''.join(reversed(lines))}</svg>"
    )
