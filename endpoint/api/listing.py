"""`/api/robots` and its siblings: the graph as JSON for programs without SPARQL, by one query each.

Lists are paged by keyset: a cursor names the item after which to continue, so that pages neither
repeat nor miss items, whatever is written meanwhile.
"""

from __future__ import annotations

import base64
import csv
import datetime as dt
import difflib
import io
import json
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import unquote, urlencode

import ontology
from endpoint.api.collections import COLLECTIONS, Collection, Kind, Member
from endpoint.http.conditional import Versions, is_current
from endpoint.http.messages import JSON_TYPE, RefusedError, Request, Response
from endpoint.http.plan import Plan
from endpoint.routes.addresses import API, CONTEXT
from endpoint.served import ServedGraph
from endpoint.sparql.negotiation import CSV, JSON_LD, choose, content_type
from rtask.engine.curation.merging import present_name
from rtask.errors import DataError, UsageError
from rtask.rdf.namespaces import PREFIXES, PROV
from rtask.rdf.terms import iri, literal

__all__ = [
    "MAX_LIMIT",
    "TYPES",
    "context",
    "plan_listing",
]

TYPES = (JSON_TYPE, JSON_LD, CSV)
LIMIT, MAX_LIMIT = 50, 1_000
_OWN = ("limit", "cursor", "fields", "total", "iri")
_SHORT_NUMBER = re.compile(r"[0-9]{1,9}")
_XSD_TIME = ontology.PREFIXES["xsd"] + "dateTime"
Item = dict[str, Any]


@dataclass(frozen=True)
class _Selection:
    """A parsed request."""

    collection: Collection
    members: tuple[Member, ...]
    patterns: tuple[str, ...]
    limit: int
    after: str
    counts: bool
    single: str


def plan_listing(kb: ServedGraph, versions: Versions, request: Request, timeout_s: float) -> Plan:
    """Plan a list or one item.

    Parameters
    ----------
    timeout_s
        Time limit of the query.

    Raises
    ------
    RefusedError
        400, naming the nearest parameter; 404 or 406.
    """
    name, _, rest = request.raw_path.removeprefix(f"{API}/").rstrip("/").partition("/")
    if request.raw_path == CONTEXT:
        document = json.dumps(context(), indent=1).encode()
        return Plan.ready(Response(200, document, JSON_LD))
    collection = COLLECTIONS[name]
    media_type = choose(request.header("accept"), TYPES)
    single = f"{kb.base}{collection.folder}/{unquote(rest)}" if rest else ""
    selection = _select(collection, request, single)
    text = _text(selection)
    etag = versions.of_query(text, media_type, selection.counts)
    if is_current(request, etag):
        return Plan.ready(Response(304, headers=(("ETag", etag),)))

    answer = _Answer(media_type, etag, request.site, selection.members)

    def run() -> Response:
        rows = kb.select(text).to_dicts()
        items = [_item(row, selection) for row in rows[: selection.limit]]
        if single:
            return _single(kb, selection, items, answer)
        body: Item = {"items": items, "next": None}
        if len(rows) > selection.limit:
            arguments = {k: v for k, v in request.parameters if k != "cursor"}
            arguments["cursor"] = _cursor(rows[selection.limit - 1], selection)
            body["next"] = f"{API}/{name}?{urlencode(arguments)}"
        if selection.counts:
            body["total"] = int(str(kb.select(_count_text(selection))[0].value("total")))
        return answer.of(body)

    return Plan(run, timeout_s=timeout_s, lane="query")


def context() -> Item:
    """Return the JSON-LD context of all items."""
    terms: Item = {"iri": "@id", "items": "@graph"}
    types: dict[Kind, str] = {"iri": "@id", "iris": "@id", "time": _XSD_TIME}
    for collection in COLLECTIONS.values():
        for member in collection.members:
            prefix, _, local = member.term.partition(":")
            if not local:
                continue
            term = ontology.PREFIXES[prefix] + local
            kind = types.get(member.kind)
            terms[member.name] = {"@id": term, "@type": kind} if kind else term
    return {"@context": terms}


def _select(collection: Collection, request: Request, single: str) -> _Selection:
    """Read the parameters."""
    given: dict[str, str] = {}
    filters = {filter_.name: filter_ for filter_ in collection.filters}
    names = [*filters, *_OWN]
    for name, value in request.parameters:
        if name not in names:
            near = difflib.get_close_matches(name, names, n=1)
            hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(names)}"
            raise UsageError(f"unknown parameter {name!r}; {hint}", field=name)
        if name in given:
            raise UsageError(f"{name} is given twice", field=name)
        given[name] = value
    patterns = [
        filter_.pattern.replace("$value", _term(filter_.kind, given[name], name))
        for name, filter_ in filters.items()
        if name in given
    ]
    patterns += [
        f"VALUES ?iri {{ {_term('iri', name, 'iri')} }}"
        for name in (single, given.get("iri", ""))
        if name
    ]
    limit = given.get("limit", str(LIMIT))
    if not _SHORT_NUMBER.fullmatch(limit) or not 1 <= int(limit) <= MAX_LIMIT:
        raise UsageError(f"limit: expected a whole number from 1 to {MAX_LIMIT}", field="limit")
    after = _after(collection, given["cursor"]) if "cursor" in given else ""
    return _Selection(
        collection, _members(collection, given.get("fields", "")), tuple(patterns), int(limit),
        after, given.get("total", "") in ("1", "true"), single,
    )  # fmt: skip


def _members(collection: Collection, fields: str) -> tuple[Member, ...]:
    """Return the requested members; all unless some are named."""
    every = {member.name: member for member in collection.members}
    names = [name.strip() for name in fields.split(",") if name.strip()]
    for name in names:
        if name not in every and name != "iri":
            near = difflib.get_close_matches(name, every, n=1)
            hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(every)}"
            raise UsageError(f"fields: unknown {name!r}; {hint}", field="fields")
    return tuple(m for m in every.values() if not names or m.name in names)


def _term(kind: Kind, value: str, name: str) -> str:
    """Return a parameter as a term of SPARQL."""
    if kind == "iri":
        try:
            return str(iri(value))
        except DataError as error:
            raise UsageError(f"{name}: {error}", field=name) from None
    if kind == "boolean":
        if value not in ("true", "false"):
            raise UsageError(f"{name}: expected true or false", field=name)
        return value
    if kind == "time":
        try:
            moment = dt.datetime.fromisoformat(value)
        except ValueError:
            raise UsageError(
                f"{name}: expected a time such as 2026-01-31T12:00:00Z", field=name
            ) from None
        moment = moment if moment.tzinfo else moment.replace(tzinfo=dt.UTC)
        return f'"{moment.isoformat()}"^^<{_XSD_TIME}>'
    return str(literal(value))


def _cursor(row: Mapping[str, Any], selection: _Selection) -> str:
    """Return the cursor of a row: its place in the order of the list."""
    place = [str(row["iri"]), *([_moment(row["time"])] if selection.collection.by_time else [])]
    return base64.urlsafe_b64encode(json.dumps(place).encode()).decode().rstrip("=")


def _after(collection: Collection, cursor: str) -> str:
    """Return the filter that continues after a cursor."""
    try:
        place = json.loads(base64.urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4)))
        if not isinstance(place, list) or len(place) != 1 + collection.by_time:
            raise ValueError
        last = literal(str(place[0]))
        if not collection.by_time:
            return f"FILTER(STR(?iri) > {last})"
        time = _term("time", str(place[1]), "cursor")
    except (ValueError, RecursionError, UsageError):
        raise UsageError("cursor: take it from `next` of a page before", field="cursor") from None
    return f"FILTER(?time < {time} || (?time = {time} && STR(?iri) < {last}))"


def _text(selection: _Selection) -> str:
    """Return the query of one page: its items, and each block of members about them."""
    chosen, names = _chosen(selection), [member.name for member in selection.members]
    blocks = []
    for block in selection.collection.blocks:
        bindings = [f"({m.value} AS ?{m.name})" for m in block.members if m.name in names]
        if bindings:
            inner = f"{{ SELECT ?iri {{ {{ {chosen} }} }} }} {block.pattern}"
            blocks.append(
                f"OPTIONAL {{ SELECT ?iri {' '.join(bindings)} {{ {inner} }} GROUP BY ?iri }}"
            )
    return f"{PREFIXES}SELECT * {{ {{ {chosen} }} {' '.join(blocks)} }} {_order(selection)}"


def _chosen(selection: _Selection, *, page: bool = True) -> str:
    """Return the sub-select of the items on one page, or of all that pass the filters."""
    where = " . ".join((selection.collection.pattern, *selection.patterns))
    if selection.collection.by_time:
        grouped = f"SELECT ?iri (MAX(?ended) AS ?time) {{ {where} }} GROUP BY ?iri"
        inner = f"SELECT ?iri ?time {{ {{ {grouped} }} {selection.after if page else ''} }}"
    else:
        after = selection.after if page else ""
        inner = f"SELECT DISTINCT ?iri {{ {where} . {after} FILTER(isIRI(?iri)) }}"
    return f"{inner} {_order(selection)} LIMIT {selection.limit + 1}" if page else inner


def _order(selection: _Selection) -> str:
    by_time = selection.collection.by_time
    return "ORDER BY DESC(?time) DESC(STR(?iri))" if by_time else "ORDER BY STR(?iri)"


def _count_text(selection: _Selection) -> str:
    chosen = _chosen(selection, page=False)
    return f"{PREFIXES}SELECT (COUNT(*) AS ?total) {{ {{ {chosen} }} }}"


def _item(row: Mapping[str, Any], selection: _Selection) -> Item:
    """Return an item as a JSON object."""
    item: Item = {"iri": str(row["iri"])}
    for member in selection.members:
        value = row.get(member.name)
        if member.kind in ("iris", "texts"):
            item[member.name] = sorted(str(value).split("\n")) if value else []
        elif member.kind == "integer":
            item[member.name] = int(value or 0)
        elif member.kind == "time" and value is not None:
            item[member.name] = _moment(value)
        elif isinstance(value, float) and not math.isfinite(value):
            item[member.name] = None  # JSON has no NaN or infinity
        else:
            item[member.name] = value
    return item


def _moment(value: Any) -> str:
    return value.isoformat() if isinstance(value, dt.datetime) else str(value)


def _single(kb: ServedGraph, selection: _Selection, items: list[Item], answer: _Answer) -> Response:
    """Return one item, redirect to its present name, or say why it is gone."""
    if items:
        return answer.of(items[0])
    now = present_name(kb, selection.single)
    name = selection.collection.name
    start = f"{kb.base}{selection.collection.folder}/"
    if now != selection.single and now.startswith(start):
        return Response(308, headers=(("Location", f"{API}/{name}/{now[len(start) :]}"),))
    if kb.match(selection.single, PROV.invalidatedAtTime):
        raise RefusedError(410, "gone", f"{selection.single} was forgotten")
    raise RefusedError(
        404,
        "not-found",
        f"no {selection.collection.folder} {selection.single}; see {API}/{name}",
    )


@dataclass(frozen=True)
class _Answer:
    """Media type of an answer and how it is written."""

    media_type: str
    etag: str
    site: str
    members: tuple[Member, ...]

    def of(self, body: Item) -> Response:
        """Return a list or one item in the requested media type."""
        headers = (("ETag", self.etag),)
        if self.media_type == CSV:
            table = _table(body.get("items", [body]), self.members)
            return Response(200, table, content_type(CSV), headers)
        if self.media_type == JSON_LD:
            body = {"@context": f"{self.site}{CONTEXT}", **body}
        text = json.dumps(body, ensure_ascii=False, default=str)
        return Response(200, text.encode(), self.media_type, headers)


def _table(items: Iterable[Item], members: Iterable[Member]) -> bytes:
    """Return items as a CSV table (RFC 4180)."""
    names = ["iri", *(member.name for member in members)]
    out = io.StringIO()
    rows = csv.writer(out)
    rows.writerow(names)
    for item in items:
        cells = (item[name] for name in names)
        rows.writerow([" ".join(c) if isinstance(c, list) else _cell(c) for c in cells])
    return out.getvalue().encode()


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return str(value).lower() if isinstance(value, bool) else str(value)
