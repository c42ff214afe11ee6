"""Protocol requests as they are read (SPARQL 1.1 Protocol, 2.1 and 2.2)."""

from __future__ import annotations

import random
from urllib.parse import quote, unquote_plus

import pytest

from endpoint.http.messages import RefusedError, Request, parse_fields
from endpoint.sparql.request import (
    QUERY,
    UPDATE,
    DescriptionRequest,
    QueryRequest,
    UpdateRequest,
    parse_operation,
)

FORM = {"content-type": "application/x-www-form-urlencoded"}
QUERY_BODY = {"content-type": "application/sparql-query"}
UPDATE_BODY = {"content-type": "application/sparql-update"}


def get(query_string: str) -> Request:
    return Request("GET", "/sparql", query_string)


def post(headers: dict[str, str], body: bytes | str, query_string: str = "") -> Request:
    data = body.encode() if isinstance(body, str) else body
    return Request("POST", "/sparql", query_string, headers, data)


@pytest.mark.parametrize(
    "request_",
    [
        get("query=ASK%20%7B%7D"),
        get("query=ASK+{}&format=json&output=json"),
        post(FORM, "query=ASK%20%7B%7D"),
        post(QUERY_BODY, "ASK {}"),
        post({"content-type": 'APPLICATION/SPARQL-QUERY;charset="UTF-8"'}, "ASK {}"),
    ],
)
def test_a_query_comes_in_three_ways(request_: Request) -> None:
    operation = parse_operation(request_)
    assert isinstance(operation, QueryRequest)
    assert operation.text == "ASK {}"
    assert operation.base == "http://localhost/sparql"


@pytest.mark.parametrize(
    "request_", [post(FORM, "update=CLEAR+ALL"), post(UPDATE_BODY, "CLEAR ALL")]
)
def test_an_update_comes_in_two_ways(request_: Request) -> None:
    operation = parse_operation(request_)
    assert isinstance(operation, UpdateRequest)
    assert operation.text == "CLEAR ALL"


def test_form_and_url_fields_are_joined() -> None:
    request = post(FORM, "query=ASK{}&default-graph-uri=urn:a", "default-graph-uri=urn:b")
    operation = parse_operation(request)
    assert isinstance(operation, QueryRequest)
    assert operation.default_graphs == ("urn:a", "urn:b")


def test_the_dataset_of_an_update_is_read() -> None:
    request = post(UPDATE_BODY, "x", "using-graph-uri=urn:a&using-named-graph-uri=urn:b")
    operation = parse_operation(request)
    assert isinstance(operation, UpdateRequest)
    assert (operation.using, operation.using_named) == (("urn:a",), ("urn:b",))


def test_a_get_without_a_query_asks_for_the_description() -> None:
    assert isinstance(parse_operation(get("")), DescriptionRequest)


@pytest.mark.parametrize(
    ("request_", "status"),
    [
        (get("update=CLEAR+ALL"), 400),
        (get("query=ASK{}&query=ASK{}"), 400),
        (get("query="), 400),
        (get("query=%20%0A"), 400),
        (get("query=%zz"), 400),
        (get("query=%FF"), 400),
        (get("query=ASK%00"), 400),
        (get("query=ASK{}&timeout=abc"), 400),
        (get("query=ASK{}&timeout=-1"), 400),
        (get("query=ASK{}&inferred=maybe"), 400),
        (get("query=ASK{}&default-graph-uri=" + quote("not an iri <>", safe="")), 400),
        (get("query=ASK{}&named-graph-uri=relative"), 400),
        (get("query=ASK{}&" + "&".join("x=1" for _ in range(3_000))), 400),
        (post(FORM, "query=ASK{}&query=ASK{}"), 400),
        (post(FORM, "query=ASK{}&update=CLEAR+ALL"), 400),
        (post(FORM, "update=x&update=y"), 400),
        (post(FORM, ""), 400),
        (post(QUERY_BODY, "ASK {}", "query=ASK{}"), 400),
        (post(QUERY_BODY, b"ASK { \xff }"), 400),
        (post({}, "ASK {}"), 415),
        (post({"content-type": "text/plain"}, "ASK {}"), 415),
        (post({"content-type": "application/sparql-query; charset=utf-16"}, "ASK {}"), 415),
    ],
)
def test_what_the_protocol_does_not_allow_is_refused(request_: Request, status: int) -> None:
    with pytest.raises(RefusedError) as caught:
        parse_operation(request_)
    assert caught.value.http_status == status


def test_a_wrong_type_names_the_right_ones() -> None:
    with pytest.raises(RefusedError) as caught:
        parse_operation(post({}, "ASK {}"))
    accepted = dict(caught.value.headers)["Accept-Post"]
    assert "application/sparql-query" in accepted
    assert "application/sparql-update" in accepted


def test_the_split_addresses_take_their_own_kind_only() -> None:
    with pytest.raises(RefusedError):
        parse_operation(post(UPDATE_BODY, "CLEAR ALL"), (QUERY,))
    with pytest.raises(RefusedError):
        parse_operation(post(QUERY_BODY, "ASK {}"), (UPDATE,))


def test_time_limit_and_inference_are_read() -> None:
    operation = parse_operation(get("query=ASK{}&timeout=2.5&inferred=0"))
    assert isinstance(operation, QueryRequest)
    assert (operation.timeout_s, operation.inferred) == (2.5, False)


def test_escapes_are_decoded_as_the_standard_library_decodes_them() -> None:
    chance = random.Random(3)
    pieces = [
        "a",
        "Z",
        "=",
        "+",
        "%2B",
        "%3D",
        "%0A",
        "%0d",
        "%20",
        "%C3%A9",
        "%5C",
        "_",
        "/",
        "\n",
    ]
    for _ in range(2_000):
        value = "".join(chance.choice(pieces) for _ in range(chance.randrange(12)))
        assert parse_fields(f"query={value}", "form") == [("query", unquote_plus(value))]
    for broken in ("%FF", "%C3", "%C3+%A9"):
        with pytest.raises(RefusedError, match="not UTF-8"):
            parse_fields(f"query={broken}", "form")


@pytest.mark.parametrize(
    ("request_", "message"),
    [
        (get("query=ASK%7B%7D&infered=0"), "`infered`; did you mean `inferred`"),
        (get("query=ASK%7B%7D&as-of=3"), "did you mean `as_of`"),
        (get("qurey=ASK%7B%7D"), "did you mean `query`"),
        (post(FORM, "update=CLEAR+ALL&timeout=3"), "`timeout`"),
        (post(UPDATE_BODY, "CLEAR ALL", "if_version=a:1"), "did you mean `if-version`"),
        (post(QUERY_BODY, "ASK {}", "using-graph-uri=urn:a"), "`using-graph-uri`"),
    ],
)
def test_a_parameter_without_a_meaning_is_refused_by_name(request_: Request, message: str) -> None:
    with pytest.raises(RefusedError, match=message) as error:
        parse_operation(request_)
    assert error.value.http_status == 400
