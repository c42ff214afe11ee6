"""The pages of a copy that lags say so: what is missing there may be at its writer."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from types import SimpleNamespace

import pytest

import rtask
from endpoint.access.tokens import TokenStore
from endpoint.rosbridge.services import NoEngine
from endpoint.settings import Config
from endpoint.wsgi import create_app
from tests.servers import new_application


@pytest.fixture
def writer() -> SimpleNamespace:
    return SimpleNamespace(
        url="http://writer:8765",
        commits_behind=0,
        seconds_behind=0.25,
        is_connected=True,
        forwards=True,
        records_waiting=0,
        records_dropped=0,
        close=lambda: None,
    )


@pytest.fixture
def pages(writer: SimpleNamespace) -> Iterator[object]:
    with closing(TokenStore(None)) as tokens, rtask.open(":memory:", ontologies=False) as kb:
        application = new_application(kb, NoEngine(), tokens, Config(), following=writer)
        app = create_app(application)
        yield app.test_client()
        application.close()


@pytest.mark.parametrize("address", ["/objects", "/search?q=mug", "/robots"])
def test_a_page_of_a_copy_says_that_it_lags(
    pages: object, writer: SimpleNamespace, address: str
) -> None:
    def text() -> str:
        answer = pages.get(address)  # type: ignore[attr-defined]
        assert answer.status_code == 200
        assert answer.headers["RTASK-Staleness"] == f"{writer.seconds_behind:.3f}"
        return str(answer.text)

    assert "behind its writer" not in text()
    writer.commits_behind = 1
    assert "This copy is a commit behind its writer: what is missing here may be there." in text()
    writer.commits_behind = 12
    assert "This copy is 12 commits behind its writer" in text()
    writer.is_connected, writer.seconds_behind = False, 90.0
    assert "This copy has not heard of its writer for 90 s" in text()
