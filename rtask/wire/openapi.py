"""JSON Schema (draft 2020-12) of messages, as the components of an OpenAPI 3.1 document.

The schema is the canonical form of a message: one name for each field, numbers as numbers. What is
accepted besides is said in words. ``x-unit``, ``x-ros-type`` and ``x-absent`` give the unit, the
ROS type and what leaving the field out means.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema, models_json_schema

from rtask.wire.fields import absence, parts_of
from rtask.wire.message import Message
from rtask.wire.ros import ros_types

__all__ = ["components"]

JsonObject = dict[str, Any]

_REF = "#/components/schemas/"
# Bounds on types with a reader of their own keep the names of the Python annotations.
_BOUNDS = {"ge": "minimum", "le": "maximum", "min_length": "minItems", "max_length": "maxItems"}


class _Untitled(GenerateJsonSchema):
    def field_title_should_be_set(self, schema: Any) -> bool:
        return False


def components(models: Mapping[str, type[BaseModel]]) -> JsonObject:
    """Return the schemas of messages and of all messages in them, by name.

    Parameters
    ----------
    models
        Messages by the names that they are to have; their parts have the names of their classes.

    Raises
    ------
    ValueError
        Two messages would have one name.

    Examples
    --------
    >>> from rtask.wire.message import Message
    >>> class Cup(Message):
    ...     '''A cup.'''
    ...     height: float = 0.1
    >>> components({"CupRequest": Cup})["CupRequest"]["properties"]
    {'height': {'default': 0.1, 'type': 'number', 'x-ros-type': 'float64[]', 'x-absent': '0.1'}}
    """
    distinct = list(dict.fromkeys(models.values()))
    schemas = models_json_schema(
        [(model, "validation") for model in distinct],
        ref_template=_REF + "{model}",
        schema_generator=_Untitled,
    )[1].get("$defs", {})
    names = {model.__name__: name for name, model in models.items()}
    if len(names) < len(distinct) or "__" in "".join(schemas):
        raise ValueError(f"two messages have one name, among {', '.join(sorted(schemas))}")
    parts = {name: part for model in distinct for name, part in parts_of(model).items()}
    classes = {**parts, **{model.__name__: model for model in distinct}}
    described = {}
    for name, schema in schemas.items():
        clean = described[names.get(name, name)] = _schema(schema, names)
        _add_absence(clean, names.get(name, name), classes[name])
    return dict(sorted(described.items()))


def type_in_words(schema: Mapping[str, Any]) -> str:
    """Return the type of a field as it is declared, from its published schema.

    A field that may be left out is a list in a typed ROS message, and none for other callers.

    Examples
    --------
    >>> type_in_words({"type": "number", "default": 0.1, "x-ros-type": "float64[]"})
    'float64'
    >>> type_in_words({"type": "array", "items": {"type": "number"}, "x-ros-type": "float64[]"})
    'float64[]'
    """
    choices = (schema, *schema.get("anyOf", ()))
    is_list = any(choice.get("type") == "array" for choice in choices)
    ros_type = str(schema.get("x-ros-type", ""))
    return ros_type if is_list else ros_type.removesuffix("[]")


def _add_absence(schema: JsonObject, name: str, model: type[BaseModel]) -> None:
    """Add to each field of a request its ROS type and what leaving it out means."""
    if not issubclass(model, Message):
        return
    members = ros_types(f"rtask/{name}", model)[f"rtask/{name}"]
    for member, field in zip(members, model.model_fields.values(), strict=True):
        published = schema["properties"][member.name]
        published["x-ros-type"] = str(member)
        if not field.is_required():
            published["x-absent"] = absence(field)


def _schema(schema: JsonObject, names: Mapping[str, str]) -> JsonObject:
    """Return a schema without titles and defaults that are null, with units in the words."""
    clean: JsonObject = {}
    for key, value in schema.items():
        if key in ("title", "description") or (key == "default" and value is None):
            continue
        if key == "properties":
            clean[key] = {name: _schema(part, names) for name, part in value.items()}
        elif key in ("items", "additionalProperties") and isinstance(value, dict):
            clean[key] = _schema(value, names)
        elif key == "anyOf":
            clean[key] = [_schema(part, names) for part in value]
        elif key == "$ref":
            name = value.removeprefix(_REF)
            clean[key] = _REF + names.get(name, name)
        else:
            clean[_BOUNDS.get(key, key)] = value
    if "description" in schema:
        unit = _unit(clean)
        clean["description"] = schema["description"] + (f" ({unit})" if unit else "")
    return clean


def _unit(schema: JsonObject) -> str:
    units = (part["x-unit"] for part in (schema, *schema.get("anyOf", ())) if "x-unit" in part)
    return next(units, "")
