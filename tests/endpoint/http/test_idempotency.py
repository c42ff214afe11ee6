"""A key stores once: as the id of what is reported, else by the answer that is remembered."""

from __future__ import annotations

from typing import Any

import pytest

from endpoint.http.idempotency import IdempotencyKeys
from endpoint.http.messages import RefusedError, Request
from rtask.engine.operations.table import OPERATIONS
from rtask.errors import UsageError
from rtask.wire.fields import request_id_of
from rtask.wire.message import Answer


class Server:
    """Carries out operations with a key, and lists the arguments of each."""

    def __init__(self) -> None:
        self.keys, self.carried_out = IdempotencyKeys(), list[dict[str, Any]]()

    def send(self, operation: str, args: dict[str, Any], key: str = "k-1") -> Answer:
        request = Request("POST", f"/engine/{operation}", "", {"idempotency-key": key},
                          repr(args).encode())  # fmt: skip
        ids = request_id_of(OPERATIONS[operation].request)
        return self.keys.prepared(request, operation, "ann", ids, args, self._carry_out)()

    def _carry_out(self, args: dict[str, Any]) -> Answer:
        self.carried_out.append(args)
        return Answer()


def test_the_key_is_the_id_of_what_is_reported() -> None:
    server = Server()
    server.send("report_outcome", {"success": True})
    server.send("insert_object", {"objects": [{"data": "x"}, {"task_id": "t-1"}]})
    server.send("insert_object", {"data": "x"}, "k-2")
    server.send("teach_object", {"operation": "teach"})
    ids = [[one.get("task_id") for one in args.get("objects", [args])]
           for args in server.carried_out]  # fmt: skip
    assert ids == [["k-1"], ["k-1.0", "t-1"], ["k-2"], ["k-1"]]


@pytest.mark.parametrize(
    ("operation", "args"),
    [
        ("teach_object", {"operation": "confirm", "grasp": "urn:g"}),
        ("teach_object", {"operation": "confirm", "task_id": "t-1"}),
        ("give_feedback", {"task_id": "t-1", "verdict": "confirm"}),
        ("curate_object", {"operation": "forget", "object": "urn:o"}),
        ("register_robot", {"name": "nao-1"}),
    ],
)
def test_where_an_id_means_another_request_the_key_does_not_replace_it(
    operation: str, args: dict[str, Any]
) -> None:
    server = Server()
    first = server.send(operation, args)
    assert server.send(operation, args) is first
    assert server.carried_out == [args]


def test_a_key_that_is_malformed_or_used_for_another_body_is_refused() -> None:
    server = Server()
    server.send("curate_object", {"operation": "forget", "object": "urn:o"})
    with pytest.raises(RefusedError, match="k-1 was used with another body"):
        server.send("curate_object", {"operation": "forget", "object": "urn:p"})
    with pytest.raises(UsageError, match="expected 1 to 200 letters"):
        server.send("curate_object", {}, "no spaces")
