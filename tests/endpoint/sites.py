"""A server of several people that other machines reach, for tests of pages."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager
from typing import Self

from flask.testing import FlaskClient

import rtask
from endpoint.access.tokens import TokenStore
from endpoint.settings import Config
from endpoint.wsgi import create_app
from rtask.engine import Engine
from tests.servers import new_application

__all__ = ["HOST", "OWN", "Site"]

HOST = "http://robots.lab:8765"
OWN = {"Origin": HOST}


class Site:
    """A guarded server over a graph in memory; robot nao-1 wrote what it holds."""

    def __init__(self, tokens: TokenStore, facts: str) -> None:
        self.tokens = {
            "ann": tokens.create("teacher", agent="ann")[0],
            "bob": tokens.create("teacher", agent="bob")[0],
            "nao-1": tokens.create("robot", agent="nao-1")[0],
            "boss": tokens.create("admin")[0],
        }
        self.kb = rtask.open(":memory:", base="urn:lab/")
        self.kb.update(facts, "nao-1")
        self.engine = Engine(self.kb)
        self.app = create_app(
            new_application(self.kb, self.engine, tokens, Config(host="0.0.0.0", write_rate=1e6))
        )

    @classmethod
    @contextmanager
    def opened(cls, facts: str) -> Iterator[Self]:
        """Open a site with the facts of an update; close it at the end."""
        with closing(TokenStore(None)) as tokens:
            site = cls(tokens, facts)
            try:
                yield site
            finally:
                site.app.extensions["rtask"].close()
                site.engine.close()
                site.kb.close()

    def signed_in(self, name: str) -> FlaskClient:
        """Return the browser of somebody who signed in."""
        browser = self.app.test_client()
        token = {"token": self.tokens[name]}
        assert browser.post("/login", data=token, base_url=HOST, headers=OWN).status_code == 303
        return browser
