"""The methods that programs see are those that the operations declare."""

from __future__ import annotations

import inspect
from pathlib import Path

import pytest

import rtask.client.calls
from rtask.client.base import Client
from rtask.client.failures import Patience
from rtask.engine.operations.table import OPERATIONS, client_source


def test_the_file_is_what_the_declarations_make():
    made = Path(rtask.client.calls.__file__).read_text(encoding="utf-8")
    assert made == client_source(), (
        "python -m rtask.engine.operations.table > rtask/client/calls.py"
    )


@pytest.mark.parametrize("name", sorted(OPERATIONS))
def test_an_operation_is_a_method_with_its_fields_as_keywords(name):
    operation = OPERATIONS[name]
    signature = inspect.signature(getattr(Client, name))
    assert signature.return_annotation == operation.answer.__name__
    accepted = [parameter for parameter in signature.parameters if parameter != "self"]
    assert set(operation.request.wire_names) <= set(accepted)
    assert {signature.parameters[one].kind for one in accepted} == {inspect.Parameter.KEYWORD_ONLY}


class Recorder(Client):
    """A client that remembers what it would send."""

    def __init__(self):
        super().__init__()
        self.sent = []

    def _call(self, operation, args, timeout_s=None):
        self.sent.append((operation, args))
        return {}

    def query(self, sparql):
        raise NotImplementedError

    ask = update = follow = query

    def close(self):
        pass


def test_only_what_is_given_is_sent():
    client = Recorder()
    client.recall_grasps(object="urn:cup", in_space=False)
    client.teach_object(operation="search", class_description="a cup")
    client.resolve_request(wanted="a cup", objects=[])
    assert client.sent == [
        ("recall_grasps", {"object": "urn:cup", "in_space": False}),
        ("teach_object", {"operation": "search", "class_description": "a cup"}),
        ("resolve_request", {"wanted": "a cup", "objects": []}),
    ]


def test_one_object_may_be_told_without_a_list():
    client = Recorder()
    client.insert_object(data=b"RTKC", name="cup", task_id="t-1")
    assert client.sent == [("insert_object", {"data": "UlRLQw==", "name": "cup", "task_id": "t-1"})]


def test_a_misspelt_field_is_refused_before_it_is_sent():
    with pytest.raises(TypeError, match="objct"):
        Recorder().recall_grasps(objct="urn:cup")


def test_patience_ends_at_its_deadline():
    patience = Patience(0.35)
    tries = 0
    while patience.wait():
        tries += 1
    assert 1 <= tries <= 5  # pauses of 0.05 to 0.1, 0.1 to 0.2, ... fit so often
    assert patience.left_s > 0  # it did not sleep to say no
