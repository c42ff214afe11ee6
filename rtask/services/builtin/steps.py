"""A step of a pipeline, its references, and what a saved pipeline takes and answers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import Field

from rtask.errors import UsageError, nearest
from rtask.services.definition import Method
from rtask.services.description import request_schema, schemas
from rtask.services.outward.announced import announced
from rtask.services.pipelines import METHOD
from rtask.wire.effect import strongest
from rtask.wire.message import Message, read
from rtask.wire.types import Text

__all__ = ["INPUT", "REF", "Step", "interface", "ref_of", "refs_in"]

REF, INPUT = "$ref", "$input"
Schema = dict[str, Any]
_ANYTHING: Schema = {
    "anyOf": [{"type": kind} for kind in ("string", "number", "boolean", "array", "object")]
}


class Step(Message):
    """One call of a pipeline."""

    id: Text
    """name under which other steps refer to the answer"""
    call: Text
    """<namespace>/<name>[@version]/<method>"""
    inputs: dict[str, Any] = Field(default_factory=dict)
    """the request; {"$ref": "step.field"} and {"$input": "name"} stand for values"""
    each: dict[str, Any] | None = None
    """a list to call for each entry of, which is "item" in the inputs; default: one call"""
    data: dict[str, str] | None = None
    """datasets for the data resources; default: none"""


def refs_in(value: Any) -> Iterator[tuple[str, str]]:
    """Yield each reference in a value: its kind and its path."""
    reference = ref_of(value)
    if reference is not None:
        yield reference
    elif isinstance(value, Mapping):
        for part in value.values():
            yield from refs_in(part)
    elif isinstance(value, list):
        for part in value:
            yield from refs_in(part)


def ref_of(value: Any) -> tuple[str, str] | None:
    """Return kind and path if a value is itself a reference; other values stand for themselves."""
    if isinstance(value, Mapping) and len(value) == 1:
        kind, path = next(iter(value.items()))
        if kind in (REF, INPUT) and isinstance(path, str):
            return kind, path
    return None


def interface(
    steps: Mapping[str, Step],
    methods: Mapping[str, Method],
    output: Mapping[str, Any],
    defaults: Mapping[str, Any],
) -> Schema:
    """Return the only method of a pipeline as ``GET /services/...`` describes methods.

    Parameters
    ----------
    steps, methods
        The calls and what they call, by the names of the steps.
    output
        The values to answer, by name.
    defaults
        Values of inputs that callers may leave out.

    Raises
    ------
    UsageError
        A default is of no input, or no value of it.
    """
    inputs = _inputs(steps, methods, output)
    defaults = {name: value for name, value in defaults.items() if value is not None}
    for name in defaults:
        if name not in inputs:
            raise UsageError(
                f"defaults: there is no input {name!r}{nearest(name, list(inputs)) or ''}"
            )
    _check_defaults({name: inputs[name][0] for name in defaults}, defaults)
    taken = {
        name: {**schema, "default": defaults[name]} if name in defaults else schema
        for name, (schema, _) in inputs.items()
    }
    required = [n for n, (_, is_needed) in inputs.items() if is_needed and n not in defaults]
    answered = {name: _answered(step_, steps, methods, taken) for name, step_ in output.items()}
    return {
        METHOD: {
            "summary": f"Run {', '.join(step_.call for step_ in steps.values())}",
            "effect": strongest(*(step_.effect for step_ in methods.values())),
            "request": {"type": "object", "properties": taken, "required": required},
            "answer": {"type": "object", "properties": answered, "required": list(answered)},
        }
    }


def _check_defaults(inputs: Mapping[str, Schema], defaults: Mapping[str, Any]) -> None:
    """Refuse defaults that a call could not give."""
    request = {"type": "object", "properties": inputs, "required": list(inputs)}
    described = {METHOD: {"request": request, "answer": {}}}
    probe = announced({"name": "any/Any", "version": "0.0.0", "methods": described})
    try:
        read(probe.methods[METHOD].request, dict(defaults))
    except UsageError as error:
        raise UsageError(f"defaults: {error}") from error


def _inputs(
    steps: Mapping[str, Step], methods: Mapping[str, Method], output: Mapping[str, Any]
) -> dict[str, tuple[Schema, bool]]:
    """Return each input's schema, and whether it must be given.

    It is that of the first field that takes the input as it is; what is only put into a larger
    value may be anything.
    """
    inputs: dict[str, tuple[Schema, bool]] = {}
    for name, step in steps.items():
        request = request_schema(methods[name])
        for own, value in step.inputs.items():
            kind, path = ref_of(value) or ("", "")
            if kind == INPUT and path not in inputs:
                schema = {k: v for k, v in request["properties"][own].items() if k != "default"}
                inputs[path] = schema, own in request.get("required", ())
    for kind, path in refs_in(
        [*(s.inputs for s in steps.values()), *(s.each for s in steps.values()), output]
    ):
        if kind == INPUT:
            inputs.setdefault(path, (_ANYTHING, True))
    return inputs


def _answered(
    value: Any,
    steps: Mapping[str, Step],
    methods: Mapping[str, Method],
    taken: Mapping[str, Schema],
) -> Schema:
    """Return the schema of one value of the answer."""
    kind, path = ref_of(value) or ("", "")
    if kind == INPUT:
        return taken[path]
    step, _, field = path.partition(".")
    if kind == REF and step in steps:
        is_list = steps[step].each is not None
        if not field:
            return {"type": "array", "items": {"type": "object"}} if is_list else {"type": "object"}
        method = methods[step]
        members = schemas(method)[method.answer.__name__].get("properties", {})
        if not is_list and field in members:
            schema: Schema = members[field]
            return schema
    return _ANYTHING
