"""Search: objects, robots, classes, properties, services, datasets and pages by their names."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterable
from dataclasses import dataclass

import flask
from werkzeug.wrappers import Response as WerkzeugResponse

import ontology
from endpoint.activity.words import title
from endpoint.http.messages import RefusedError
from endpoint.pages.graph.resource import expand
from endpoint.pages.navigation import is_offered
from endpoint.pages.render import (
    Model,
    about,
    blueprint,
    context,
    knowledge_base,
    object_url,
    page,
    resource_url,
    robot_url,
)
from endpoint.pages.render import select as run_select
from endpoint.pages.services.datasets import readable_datasets

PER_GROUP = 5
MAX_QUERY = 200
GROUPS = ("objects", "robots", "classes", "properties", "services", "datasets", "pages")
_PAGES = (
    ("/activity", "Live activity", "watch robots camera now events"),
    ("/sparql", "SPARQL workbench", "ask query"),
    ("/ask", "Ask in words", "questions answer"),
    ("/terms", "Terms", "vocabulary ontology properties"),
    ("/objects", "Objects", "things"),
    ("/classes", "Classes", "ontology tree kinds"),
    ("/robots", "Robots", ""),
    ("/feedback", "Outcomes", "feedback attempts judge verdicts"),
    ("/world", "The world", "where things places tables rooms frames map scene gltf usd"),
    ("/plan", "Plan", "tasks goal robots steps assign"),
    ("/questions", "Questions of robots", "ask answer stuck help people price"),
    ("/learning", "Learning", "success curves beliefs experience shared alone"),
    ("/services", "Services", "algorithms methods forms call"),
    ("/tools/grasp", "Grasp editor", "tool push outline polygon whiskers plan"),
    ("/tools/arm", "Arm and planning", "tool kinematics motion path trajectory joints"),
    ("/tools/pipeline", "Compose a pipeline", "tool services steps together run"),
    ("/benchmarks", "Benchmarks", "speed figures peers compared"),
    ("/setup", "Set up a robot", "register gripper sensor camera urdf describe"),
    ("/datasets", "Datasets", "files versions fork merge"),
    ("/jobs", "Jobs", "calls progress cancel"),
    ("/operations", "Operations", "engine forms"),
    ("/teach", "Teach", "name unnamed kind"),
    ("/curation", "Changes by people", "curation merge split forget undo"),
    ("/openapi", "Interface for programs", "openapi http api"),
    ("/admin/tokens", "Tokens", "operators sign access"),
    ("/admin/proposals", "Proposals", "operators axioms adopt refuse decide"),
    ("/admin/audit", "Audit trail", "operators history denied"),
)
_WORD = re.compile(r"\w+")


@dataclass(frozen=True)
class Entry:
    """Something that can be found.

    Parameters
    ----------
    group
        One of :data:`GROUPS`.
    title, detail
        What is shown.
    address
        Its page.
    words
        Words by which it is found, case-folded.
    """

    group: str
    title: str
    detail: str
    address: str
    words: tuple[str, ...]


class _Cache:
    """The entries of one state of the graph."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.version: tuple[str, int] | None = None
        self.entries: list[Entry] = []


def entries() -> list[Entry]:
    """Return all entries; they are read again after a commit."""
    kb = knowledge_base()
    version = (kb.epoch, kb.seq)
    cache: _Cache = flask.current_app.extensions.setdefault("rtask.search", _Cache())
    with cache.lock:
        if cache.version != version:
            cache.entries = list(_read())
            cache.version = version
        return cache.entries


def _read() -> Iterable[Entry]:
    for row in run_select("search_things"):
        iri, kinds = str(row["iri"]), str(row["kinds"] or "")
        is_object = row["group"] == "objects"
        shown = title(row["name"], kinds) if is_object else str(row["name"] or iri)
        detail = kinds if is_object else "robot"
        texts = (row["name"], row["id"], kinds)
        address = object_url(iri) if is_object else robot_url(iri)
        yield Entry(str(row["group"]), shown, detail, address, words_of(*texts))
    for row in run_select("search_terms"):
        iri = str(row["iri"])
        name = iri.removeprefix(ontology.NS) if iri.startswith(ontology.NS) else ""
        kind = {"classes": "class", "properties": "property"}[str(row["group"])]
        words = words_of(row["name"], name)
        address = about(iri, "/classes") if kind == "class" else resource_url(iri)
        yield Entry(str(row["group"]), str(row["name"]), kind, address, words)
    for address, name, more in _PAGES:
        if is_offered(address):
            yield Entry("pages", name, "page", address, words_of(name, more))


def words_of(*texts: object) -> tuple[str, ...]:
    """Return the case-folded words of some texts.

    Examples
    --------
    >>> words_of("Blue Mug", None, "nao-1/7")
    ('blue', 'mug', 'nao', '1', '7')
    """
    return tuple(_WORD.findall(" ".join(str(text) for text in texts if text).casefold()))


def rank(query: tuple[str, ...], words: tuple[str, ...]) -> int | None:
    """Return how well an entry matches, 0 best; none if a wanted word matches nothing.

    A whole word is better than the beginning of one, and that is better than one typing error.

    Examples
    --------
    >>> words = ("blue", "mug")
    >>> [rank((text,), words) for text in ("mug", "mu", "mgu", "cup")]
    [0, 1, 2, None]
    """
    worst = 0
    for prefix in query:
        if prefix in words:
            continue
        if any(word.startswith(prefix) for word in words):
            worst = max(worst, 1)
        elif any(is_near(prefix, word) for word in words):
            worst = 2
        else:
            return None
    return worst


def is_near(typed: str, word: str) -> bool:
    """Tell whether one typing error separates two words: a letter extra, missing, wrong or swapped.

    Examples
    --------
    >>> [is_near("mgu", word) for word in ("mug", "mgu", "mu", "gum", "smug")]
    [True, True, True, False, False]
    """
    if typed == word:
        return True
    if len(typed) < 3 or abs(len(typed) - len(word)) > 1:
        return False
    start = next((i for i, (a, b) in enumerate(zip(typed, word, strict=False)) if a != b), None)
    if start is None:
        return True
    rest, other = typed[start:], word[start:]
    return (
        rest[1:] == other[1:]
        or rest[1:] == other
        or rest == other[1:]
        or (rest[:2] == other[1::-1] and rest[2:] == other[2:])
    )


def _offered() -> Iterable[Entry]:
    """Return the services, and the datasets that the person may read."""
    for service in context().services.listing():
        words = words_of(service["name"], service["summary"], " ".join(service["methods"]))
        yield Entry("services", service["name"], service["summary"], service["href"], words)
    for name in readable_datasets():
        yield Entry("datasets", name, "dataset", f"/datasets/{name}", words_of(name))


@page("/search", "search.html")
def search() -> Model:
    """Return what matches the words in the address, the best first, in groups."""
    query = flask.request.args.get("q", "").strip()
    if len(query) > MAX_QUERY:
        raise RefusedError(
            400, "usage", f"{len(query)} characters; words of at most {MAX_QUERY} are looked for"
        )
    terms = words_of(query)
    ranked: dict[str, list[tuple[int, Entry]]] = {group: [] for group in GROUPS}
    if terms:
        for entry in (*entries(), *_offered()):
            place = rank(terms, entry.words)
            if place is not None:
                ranked[entry.group].append((place, entry))
    groups = []
    for group, matches in ranked.items():
        matches.sort(key=lambda match: (match[0], len(match[1].title), match[1].title))
        shown = [
            {"title": e.title, "detail": e.detail, "address": e.address}
            for _, e in matches[:PER_GROUP]
        ]
        if shown:
            groups.append({"name": group, "total": len(matches), "found": shown})
    return {"query": query, "groups": groups}


@blueprint.before_request
def _go_to_terms() -> WerkzeugResponse | None:
    """Lead an IRI or a prefixed name that is searched for to its page."""
    if flask.request.path != "/search":
        return None
    query = flask.request.args.get("q", "").strip()
    if re.fullmatch(r"[a-z][a-z0-9+.-]*:\S+", query) and expand(query) != query:
        return flask.redirect(resource_url(query), 303)
    if re.match(r"(?:https?|urn):\S+$", query):
        return flask.redirect(resource_url(query), 303)
    return None
