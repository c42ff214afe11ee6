"""The types that programs see are those that the engine reads and gives."""

from __future__ import annotations

import inspect
import typing

import pytest

from rtask.client import requests
from rtask.client.base import Client
from rtask.client.patience import Patience
from rtask.client.requests import REQUESTS
from rtask.engine.operations.answers import ANSWERS
from rtask.engine.operations.table import OPERATIONS


def names_of(fields):
    return {name for field in fields for name in (field.name, *field.aliases)}


def required_of(typed):
    hints = typing.get_type_hints(typed, include_extras=True)
    return {name for name, hint in hints.items() if typing.get_origin(hint) is typing.Required}


@pytest.mark.parametrize("name", sorted(OPERATIONS))
def test_a_request_type_has_the_fields_of_its_operation(name):
    fields = OPERATIONS[name].fields
    typed = REQUESTS[name]
    hints = typing.get_type_hints(typed)
    if name == "insert_object":
        (objects,) = fields
        assert set(hints) == {"objects"} | names_of(objects.fields)
        assert set(typing.get_type_hints(requests.NewObject)) == names_of(objects.fields)
        return
    assert set(hints) == names_of(fields)
    needed = {field.name for field in fields if field.required and not field.aliases}
    assert required_of(typed) == needed


def test_the_types_of_records_have_the_fields_of_the_records():
    register = {field.name: field for field in OPERATIONS["register_robot"].fields}
    outcome = {field.name: field for field in OPERATIONS["report_outcome"].fields}["outcome"]
    for typed, field in (
        (requests.EndEffector, register["end_effectors"]),
        (requests.Camera, register["cameras"]),
        (requests.Outcome, outcome),
    ):
        assert set(typing.get_type_hints(typed)) == names_of(field.fields)
        assert required_of(typed) == {one.name for one in field.fields if one.required}


def test_every_operation_is_a_method_with_types():
    for name in OPERATIONS:
        method = getattr(Client, name)
        assert REQUESTS[name].__name__ in str(inspect.signature(method))
        assert ANSWERS[name].__name__ in str(inspect.signature(method).return_annotation)


def test_patience_ends_at_its_deadline():
    patience = Patience(0.35)
    tries = 0
    while patience.wait():
        tries += 1
    assert 1 <= tries <= 5  # pauses of 0.05 to 0.1, 0.1 to 0.2, ... fit so often
    assert patience.left_s > 0  # it did not sleep to say no
