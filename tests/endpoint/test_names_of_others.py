"""One robot speaks first of the names of others, over HTTP; none of them is kept out by it."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass

import httpx
import pytest

import rtask
from endpoint.access.tokens import TokenStore
from tests.contested_names import AXIOMS, BASE, CONTRADICTED, ME, MERGED, PREFIXES
from tests.hostile_claims import HOSTILE, THINGS, VICTIMS, hostile_claims, own_statements
from tests.servers import RunningServer, bearer, running_server

CASES = {**CONTRADICTED, **MERGED}
DESCRIBED = {"functional data", "id"}
"""Cases in which the stranger gives a value of the owner's parts."""
SAME = "ASK { ?a <http://www.w3.org/2002/07/owl#sameAs> ?b FILTER(?a != ?b) }"
PROCESS = f"""ASK {{ ?x a <http://purl.org/ieee1872-owl/sumo-cora#Process>
    FILTER(REGEX(STR(?x), "^{BASE}robot/nao-[1-5](/thing(NUMBERS))?$")) }}"""


@dataclass(frozen=True)
class Lab:
    """A server with six robots."""

    server: RunningServer
    tokens: dict[str, dict[str, str]]

    def update(self, name: str, text: str) -> httpx.Response:
        headers = self.tokens[name] | {"Content-Type": "application/sparql-update"}
        return httpx.post(self.server.url + "/update", content=text, headers=headers, timeout=120)

    def query(self, text: str) -> httpx.Response:
        address, headers = self.server.url + "/query", self.tokens["nao-1"]
        return httpx.get(address, params={"query": text}, headers=headers, timeout=120)


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    folder = tmp_path_factory.mktemp("lab") / "kb"
    with rtask.open(folder, base=BASE) as kb:
        kb.update(f"{PREFIXES} INSERT DATA {{ GRAPH <urn:lab/axioms> {{ {AXIOMS} }} }}")
    store = TokenStore(folder)
    tokens = {name: bearer(store.create("robot", agent=name)[0]) for name in (HOSTILE, *VICTIMS)}
    store.close()
    with running_server(folder, "--write-rate", "100000") as server:
        yield Lab(server, tokens)


def update(owner: str, kind: str, statements: str) -> str:
    """Return an update about names of an owner, which are new in each kind."""
    folder = re.sub("[ ,]+", "-", kind)
    mine, its = (f"{BASE}robot/{name}/{owner}-{folder}-" for name in (HOSTILE, owner))
    own = f"PREFIX my: <{mine}> PREFIX its: <{its}> "
    for text in ("'Z'", "'7'", "'X1'"):
        statements = statements.replace(text, f"'{owner}'")
    return f"{PREFIXES}{own} INSERT DATA {{ {statements.replace(ME, f'<{its}self>')} }}"


@pytest.mark.slow
def test_five_robots_state_what_is_theirs_after_a_sixth_spoke_first(lab: Lab) -> None:
    for name in VICTIMS:
        for kind, (theirs, _) in CASES.items():
            # A value of another's parts is refused at once, all else only where it contradicts.
            expected = 403 if kind in DESCRIBED else 204
            assert lab.update(HOSTILE, update(name, kind, theirs)).status_code == expected
    answers: dict[tuple[str, str], httpx.Response] = {}

    def state_own(name: str) -> None:
        for kind, (_, own) in CASES.items():
            answers[name, kind] = lab.update(name, update(name, kind, own))

    run([threading.Thread(target=state_own, args=(name,)) for name in VICTIMS])
    refused = {case: r.text for case, r in answers.items() if r.status_code != 204}
    assert (len(answers), refused) == (len(VICTIMS) * len(CASES), {})
    assert HOSTILE in answers["nao-1", "functional number"].headers["RTASK-Remark"]
    for kind, (theirs, _) in CASES.items():
        again = lab.update(HOSTILE, update("nao-1", kind, theirs))
        assert again.status_code == 403, (kind, again.text)
    harmless = lab.update(HOSTILE, "INSERT DATA { <urn:x> <urn:p> 1 }")
    assert "in quarantine" in harmless.headers["RTASK-Remark"]
    assert lab.query(SAME).json()["boolean"] is False


@pytest.mark.slow
def test_claims_about_others_refuse_and_reclassify_none_of_them(lab: Lab) -> None:
    assert_unharmed(lab, hostile_claims(33, 25), range(3))


@pytest.mark.deep
def test_a_hundred_claims_about_others_refuse_and_reclassify_none_of_them(lab: Lab) -> None:
    assert_unharmed(lab, hostile_claims(1129, 100), range(THINGS))


def assert_unharmed(lab: Lab, claims: list[tuple[str, str]], things: range) -> list[float]:
    """Let one robot claim before and while five others insert, and look at what became of these.

    Returns the times in s that the others waited for their inserts and for `/health`.
    """
    refused: list[tuple[str, str]] = []
    statuses: dict[str, list[int]] = {}
    waits: list[float] = []
    ended = threading.Event()

    def claim(some: list[tuple[str, str]]) -> None:
        for kind, text in some:
            statuses.setdefault(kind, []).append(lab.update(HOSTILE, text).status_code)

    def claim_beside() -> None:
        claim(claims[len(claims) // 2 :])
        ended.set()

    def state_own(name: str) -> None:
        for number in things:
            started = time.perf_counter()
            answer = lab.update(name, own_statements(name, number))
            waits.append(time.perf_counter() - started)
            if answer.status_code != 204:
                refused.append((name, answer.text))

    def look() -> None:
        while not ended.wait(0.05):
            started = time.perf_counter()
            httpx.get(lab.server.url + "/health", timeout=120)
            waits.append(time.perf_counter() - started)

    victims = [threading.Thread(target=state_own, args=(name,)) for name in VICTIMS]
    claim(claims[: len(claims) // 2])
    run([threading.Thread(target=claim_beside), threading.Thread(target=look), *victims])
    assert refused == []
    assert all(status in (204, 400, 403, 422) for row in statuses.values() for status in row)
    assert lab.query(SAME).json()["boolean"] is False
    numbers = "|".join(map(str, things))
    process = PROCESS.replace("NUMBERS", numbers)
    assert lab.query(process).json()["boolean"] is False
    for name in VICTIMS:
        for number in things:
            assert lab.update(name, own_statements(name, number)).status_code == 204
    return waits


def run(threads: list[threading.Thread]) -> None:
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
