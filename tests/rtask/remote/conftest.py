"""Knowledge bases in every kind of place."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from rtask.kb.commit.inference import Inference
from rtask.kb.durability import saved_closures
from rtask.knowledge_base import KnowledgeBase
from rtask.remote import opening
from rtask.remote.dialect import Abilities
from rtask.remote.endpoints import Endpoints
from rtask.remote.probe import probe
from tests.rtask.remote.places import KINDS, MAKERS, Local, OnServer


@pytest.fixture(scope="module", params=KINDS)
def place(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Callable[..., KnowledgeBase]]:
    """Return a function that opens an empty knowledge base, or the last one again."""
    kind: str = request.param
    root = tmp_path_factory.mktemp(kind)
    if kind in ("memory", "folder"):
        yield Local(kind, root).open
        return
    server = MAKERS[kind](root / "server")
    server.start()
    found: list[Abilities] = []

    def probe_once(endpoints: Endpoints) -> Abilities:
        if not found:
            found.append(probe(endpoints))
        return found[0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(opening, "probe", probe_once)  # it is the same server each time
        yield OnServer(server, root).open
    server.kill()


@pytest.fixture
def kb(place: Callable[..., KnowledgeBase]) -> Iterator[KnowledgeBase]:
    with place() as opened:
        yield opened


@pytest.fixture
def built(monkeypatch: pytest.MonkeyPatch) -> list[Inference]:
    """Return a list to which each building of a closure from all statements is added."""
    found: list[Inference] = []
    build = Inference._build

    def noted(self: Inference) -> Any:
        found.append(self)
        return build(self)

    monkeypatch.setattr(Inference, "_build", noted)
    monkeypatch.setattr(saved_closures, "_MIN_ASSERTED", 0)
    return found
