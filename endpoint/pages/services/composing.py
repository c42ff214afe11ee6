"""Pipelines while a person composes them: reading, editing, and which outputs fit which inputs.

A pipeline is what ``rtask/Pipeline`` takes as a request: steps, inputs, output. Nothing here knows
of pages.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from rtask.errors import UnknownTermError, UsageError
from rtask.services.builtin.pipeline import MAX_STEPS
from rtask.services.builtin.steps import INPUT, REF, Step, ref_of, refs_in
from rtask.services.definition import Definition, Method
from rtask.wire.fields import Kind, kind_of
from rtask.wire.fitting import entry_of, kind_at, misfit, places_in
from rtask.wire.message import Message, read

__all__ = [
    "INPUT",
    "ITEM",
    "MAX_STEPS",
    "REF",
    "Find",
    "Json",
    "add_step",
    "asked_of",
    "board",
    "compact",
    "fitting",
    "is_reference",
    "item_kind",
    "lists_before",
    "method_of",
    "places",
    "read_pipeline",
    "remove_step",
    "rename_step",
    "tidy",
]

Json = dict[str, Any]
Find = Callable[[str], Definition]
"""Returns a service by its name; raises an UnknownTermError."""

ITEM = "item"
_BOX, _GAP, _MAX_LETTERS = (230, 44), (20, 32), 32
_NOT_IN_IDS = re.compile(r"[^A-Za-z0-9_-]")


def read_pipeline(text: str, find: Find) -> Json:
    """Return a pipeline from its JSON, each input under its own name.

    Raises
    ------
    UsageError
        Not JSON, or not a pipeline of methods that are offered, with the step.
    """
    if not text.strip():
        return {"steps": [], "inputs": {}}
    try:
        given = json.loads(text)
        json.dumps(given, ensure_ascii=False).encode()  # no half of a surrogate pair
    except (ValueError, RecursionError) as error:
        raise UsageError(f"not JSON that can be read: {error}", field="json") from None
    if not isinstance(given, dict) or not isinstance(given.get("steps", []), list):
        raise UsageError('expected an object with "steps", a list', field="json")
    if len(given.get("steps", [])) > MAX_STEPS:
        raise UsageError(f"at most {MAX_STEPS} steps", field="json")
    steps: list[Json] = []
    for given_step in given.get("steps", []):
        step = read(Step, given_step).model_dump(exclude_none=True)
        names = method_of(step, find).request.wire_names
        step["inputs"] = {names.get(name, name): value for name, value in step["inputs"].items()}
        steps.append(step)
    inputs = given.get("inputs") or {}
    return {"steps": steps, "inputs": dict(inputs) if isinstance(inputs, dict) else {}}


def compact(pipeline: Json) -> str:
    """Return the JSON of a pipeline in one line; empty for one without steps."""
    if not pipeline["steps"]:
        return ""
    shown = {name: value for name, value in pipeline.items() if value}
    return json.dumps(shown, ensure_ascii=False, separators=(",", ":"))


def method_of(step: Json, find: Find) -> Method:
    """Return the method that a step calls.

    Raises
    ------
    UsageError, UnknownTermError
        There is no such service or method, with the step.
    """
    service, _, name = str(step["call"]).rpartition("/")
    if "/" not in service:
        call = f"step {step['id']}: call {step['call']!r}"
        raise UsageError(f"{call}; expected <namespace>/<name>/<method>")
    try:
        definition = find(service)
    except UnknownTermError as error:
        raise UnknownTermError(f"step {step['id']}: {error}") from None
    if name not in definition.methods:
        raise UsageError(f"step {step['id']}: {definition.exact} has no method {name!r}")
    return definition.methods[name]


def add_step(pipeline: Json, call: str, find: Find) -> Json:
    """Return a pipeline with one step more, each of whose required inputs takes what fits first.

    The input that nothing fits is asked for when the pipeline is run if it is a file.
    """
    if len(pipeline["steps"]) >= MAX_STEPS:
        raise UsageError(f"a pipeline has at most {MAX_STEPS} steps", field="add")
    taken = {step["id"] for step in pipeline["steps"]}
    stem = _NOT_IN_IDS.sub("-", call.rpartition("/")[2])
    name = next(n for n in (stem, *(f"{stem}{k}" for k in range(2, 99))) if n not in taken)
    step: Json = {"id": name, "call": call, "inputs": {}}
    method = method_of(step, find)
    steps = pipeline["steps"]
    for own, field in method.request.model_fields.items():
        kind = kind_of(field)
        path = next(iter(fitting(kind, places(steps, find), own)), None)
        if field.is_required() and path is not None and kind.type in _SURE:
            step["inputs"][own] = {REF: path}
        elif field.is_required() and kind.type is bytes:
            step["inputs"][own] = {INPUT: _free_input(pipeline, name, own)}
    return {**pipeline, "steps": [*steps, step]}


_SURE = (bytes,)
"""Of these, the first output that fits is probably the one that is meant."""


def remove_step(pipeline: Json, number: int) -> Json:
    """Return a pipeline without a step, and without what referred to it."""
    steps = pipeline["steps"]
    gone = steps[number]["id"]
    left = [_without_refs(step, gone) for k, step in enumerate(steps) if k != number]
    return tidy({**pipeline, "steps": left})


def rename_step(pipeline: Json, number: int, name: str) -> Json:
    """Return a pipeline one of whose steps has another name, also where others refer to it.

    Raises
    ------
    UsageError
        The name is blank, taken, or holds what separates the parts of a reference.
    """
    steps = pipeline["steps"]
    old = steps[number]["id"]
    others = {step["id"] for k, step in enumerate(steps) if k != number}
    if not name or "." in name or name in others or name == ITEM:
        field = f"s{number}.id"
        raise UsageError(f"step {old}: expected a name of its own, without a dot", field=field)
    renamed = [
        {**step, "id": name if k == number else step["id"],
         "inputs": _renamed(step["inputs"], old, name),
         **({"each": _renamed(step["each"], old, name)} if "each" in step else {})}
        for k, step in enumerate(steps)
    ]  # fmt: skip
    return {**pipeline, "steps": renamed}


def places(steps: Sequence[Json], find: Find) -> list[tuple[str, Kind]]:
    """Return each place in the answers of steps with its kind, the last step's first."""
    sources: list[tuple[str, Kind]] = []
    for step in reversed(steps):
        root = Kind(method_of(step, find).answer, is_list="each" in step)
        sources += list(places_in(root, step["id"]))
    return sources


def item_kind(step: Json, before: Sequence[Json], find: Find) -> Kind | None:
    """Return the kind of the entries for each of which a step is called; None = unknown."""
    start, _, rest = str(step["each"].get(REF, "")).partition(".")
    for earlier in before:
        if earlier["id"] == start:
            root = Kind(method_of(earlier, find).answer, is_list="each" in earlier)
            listed = kind_at(root, rest)
            return entry_of(listed) if listed is not None and listed.is_list else None
    return None


def fitting(kind: Kind, offered: Sequence[tuple[str, Kind]], name: str) -> list[str]:
    """Return the places whose values fit a field, those that are called as it first."""
    paths = [path for path, source in offered if not misfit(source, kind)]
    return sorted(paths, key=lambda path: path.rpartition(".")[2] != name)


def lists_before(steps: Sequence[Json], find: Find) -> list[str]:
    """Return the lists in the answers of steps, for whose entries another may be called."""
    return [path for path, kind in places(steps, find) if kind.is_list]


def asked_of(pipeline: Json, find: Find) -> dict[str, tuple[type[Message], str]]:
    """Return the inputs that a pipeline is run with: the request and the field that take each."""
    inputs: dict[str, tuple[type[Message], str]] = {}
    for step in pipeline["steps"]:
        request = method_of(step, find).request
        for field, value in step["inputs"].items():
            if isinstance(value, Mapping) and set(value) == {INPUT} and field in _fields(request):
                inputs.setdefault(str(value[INPUT]), (request, field))
    return inputs


def _fields(request: type[Message]) -> Mapping[str, Any]:
    return request.model_fields


def _free_input(pipeline: Json, step: str, field: str) -> str:
    taken = {str(value[INPUT]) for other in pipeline["steps"] for value in other["inputs"].values()
             if isinstance(value, Mapping) and INPUT in value}  # fmt: skip
    return field if field not in taken else f"{step}_{field}"


def tidy(pipeline: Json) -> Json:
    """Return a pipeline without the inputs that no step takes any more."""
    every = [step["inputs"] for step in pipeline["steps"]]
    used = {path for kind, path in refs_in(every) if kind == INPUT}
    inputs = {name: value for name, value in pipeline["inputs"].items() if name in used}
    return {**pipeline, "inputs": inputs}


def _without_refs(step: Json, gone: str) -> Json:
    def stays(value: Any) -> bool:
        return not _starts(value, gone)

    left: Json = {**step, "inputs": {n: v for n, v in step["inputs"].items() if stays(v)}}
    if "each" in step and not stays(step["each"]):
        del left["each"]
        left["inputs"] = {n: v for n, v in left["inputs"].items() if not _starts(v, ITEM)}
    return left


def _starts(value: Any, step: str) -> bool:
    """Tell whether a value refers to a step."""
    path = value.get(REF) if isinstance(value, Mapping) else None
    return isinstance(path, str) and path.partition(".")[0] == step


def _renamed(value: Any, old: str, new: str) -> Any:
    if _starts(value, old):
        return {REF: new + value[REF][len(old) :]}
    if isinstance(value, Mapping):
        return {name: _renamed(item, old, new) for name, item in value.items()}
    return value


def is_reference(value: Any) -> bool:
    """Tell whether an input of a step stands for another value."""
    return ref_of(value) is not None


def board(composed: Json) -> Json:
    """Return where boxes and lines of a drawing are: a row for each depth of waiting."""
    rows: dict[str, int] = {}
    edges: list[tuple[str, str]] = []
    for step in composed["steps"]:
        needs = list(dict.fromkeys(_needed(step, set(rows))))
        edges += [(need, step["id"]) for need in needs]
        rows[step["id"]] = max((rows[need] + 1 for need in needs), default=0)
    at: dict[str, tuple[int, int]] = {}
    boxes: list[Json] = []
    for number, step in enumerate(composed["steps"]):
        row = rows[step["id"]]
        column = sum(rows[need] == row for need in at)
        x, y = column * (_BOX[0] + _GAP[0]) + 2, row * (_BOX[1] + _GAP[1]) + 2
        at[step["id"]] = x, y
        method = _cut(str(step["call"]).partition("/")[2])
        boxes.append(
            {"x": x, "y": y, "id": step["id"], "name": _cut(step["id"]), "number": number,
             "method": method, "each": "each" in step}
        )  # fmt: skip
    lines = [
        [at[a][0] + _BOX[0] // 2, at[a][1] + _BOX[1], at[b][0] + _BOX[0] // 2, at[b][1]]
        for a, b in edges
    ]
    width = max((need["x"] for need in boxes), default=0) + _BOX[0] + 2
    height = max((need["y"] for need in boxes), default=0) + _BOX[1] + 2
    return {"boxes": boxes, "lines": lines, "size": [width, height], "box": list(_BOX)}


def _cut(text: str) -> str:
    """Return as much of a text as a box holds."""
    return text if len(text) <= _MAX_LETTERS else f"{text[: _MAX_LETTERS - 1]}…"


def _needed(step: Json, available: set[str]) -> Iterator[str]:
    for value in [*step["inputs"].values(), step.get("each")]:
        if isinstance(value, Mapping) and isinstance(value.get(REF), str):
            start = value[REF].partition(".")[0]
            if start in available:
                yield start
