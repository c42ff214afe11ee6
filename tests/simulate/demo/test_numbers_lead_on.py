"""The recorded demo: whatever its robots learnt is a link to the outcomes and robots behind it."""

from __future__ import annotations

import html
import re
from collections import Counter
from contextlib import closing
from pathlib import Path
from urllib.parse import urlencode

import pytest

import rtask
from endpoint.access.tokens import TokenStore
from endpoint.settings import Config
from endpoint.wsgi import create_app
from rtask.engine import Engine
from simulate.demo.recorded import unpack
from tests.endpoint.pages.test_why import LEARNT, NOT_LEARNT, bare_figures
from tests.servers import new_application

QUESTIONS = (
    "Which robot fails at cartons, and why?", "How sure was the learner before an attempt?",
    "Which grasps are proven, on which gripper type?", "What did nao-1 try?",
)  # fmt: skip
STARTS = ("/", "/objects", "/robots", "/learning", "/activity", "/feedback", "/world", "/curation")
MAX_ALIKE = 6
MEASURED = re.compile(
    r"what it measured.*|opening [\d.]+( -> [\d.]+)*|\d+ px [\d.]+ to [\d.]+ m|place \d+ % occupied"
)
"""What a robot or a camera measured, which rests on nothing else."""


@pytest.mark.deep
@pytest.mark.slow
def test_every_learnt_number_of_the_demo_is_a_link(tmp_path: Path) -> None:
    unpack(tmp_path / "demo")
    waiting = [*STARTS, *(f"/ask?{urlencode({'text': text})}" for text in QUESTIONS)]
    seen, alike, looked_at = set(waiting), Counter[str](), 0
    with (
        rtask.open(tmp_path / "demo" / "store") as kb,
        closing(TokenStore(None)) as tokens,
        Engine(kb) as engine,
    ):
        application = new_application(kb, engine, tokens, Config())
        client = create_app(application).test_client()
        while waiting:
            address = waiting.pop(0)
            answer = client.get(address, headers={"Accept": "text/html"})
            if answer.status_code != 200 or answer.mimetype != "text/html":
                continue
            looked_at += 1
            bare = [
                words
                for words in bare_figures(answer.text)
                if LEARNT.search(MEASURED.sub("", words))
            ]
            assert bare == [], address
            for link in map(html.unescape, re.findall(r'href="(/[^"#]*)', answer.text)):
                kind = link.partition("?")[0]
                if link not in seen and alike[kind] < MAX_ALIKE and not NOT_LEARNT.match(kind):
                    alike[kind] += 1
                    seen.add(link)
                    waiting.append(link)
        application.close()
    assert looked_at > 50
    assert {"/ask", "/robot", "/object", "/feedback", "/world"} <= alike.keys()
