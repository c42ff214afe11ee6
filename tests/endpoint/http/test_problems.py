"""Errors as RFC 9457 problem details."""

from __future__ import annotations

import json

import pytest

from endpoint.http.messages import RefusedError
from endpoint.http.problems import PROBLEM_TYPE, problem
from rtask.errors import AuthenticationError, ForbiddenError, QuerySyntaxError


def test_an_error_of_ours_says_what_where_and_which_status() -> None:
    response = problem(QuerySyntaxError("expected }", line=2, column=7), "request-1")
    assert (response.status, response.media_type) == (400, PROBLEM_TYPE)
    assert json.loads(response.body) == {
        "type": "/errors/query-syntax",
        "title": "Bad Request",
        "status": 400,
        "detail": "expected }",
        "instance": "request-1",
        "transient": False,
        "line": 2,
        "column": 7,
    }


def test_an_unforeseen_error_says_nothing_of_the_inside(
    caplog: pytest.LogCaptureFixture,
) -> None:
    response = problem(KeyError("secret"), "request-2")
    assert response.status == 500
    assert b"secret" not in response.body
    assert "request-2" in caplog.text


def test_a_missing_token_is_challenged_and_a_wrong_one_is_called_invalid() -> None:
    missing = dict(problem(AuthenticationError("needed")).headers)
    assert missing["WWW-Authenticate"] == 'Bearer realm="rtask"'
    wrong = dict(problem(AuthenticationError("wrong", token_sent=True)).headers)
    assert 'error="invalid_token"' in wrong["WWW-Authenticate"]


def test_details_never_replace_what_the_standard_defines() -> None:
    body = json.loads(problem(ForbiddenError("no", status=200, graph="urn:g")).body)
    assert (body["status"], body["graph"]) == (403, "urn:g")


def test_a_refusal_keeps_its_headers() -> None:
    response = problem(RefusedError(405, "method-not-allowed", "no", (("Allow", "GET"),)))
    assert (response.status, dict(response.headers)["Allow"]) == (405, "GET")
