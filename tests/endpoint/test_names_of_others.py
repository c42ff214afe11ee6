"""One robot speaks first of the names of others, over HTTP; none of them is kept out by it."""

from __future__ import annotations

import threading
from pathlib import Path

import httpx

import rtask
from endpoint.access.tokens import TokenStore
from tests.contested_names import AXIOMS, BASE, CONTRADICTED, ME, MERGED, PREFIXES
from tests.servers import bearer, running_server

HOSTILE, VICTIMS = "nao-0", ("nao-1", "nao-2", "nao-3", "nao-4", "nao-5")
CASES = {**CONTRADICTED, **MERGED}


def update(owner: str, kind: str, statements: str) -> str:
    """Return an update about names of an owner, which are new in each kind."""
    folder = kind.replace(" ", "-").replace(",", "")
    mine, its = (f"{BASE}robot/{name}/{owner}-{folder}-" for name in (HOSTILE, owner))
    own = f"PREFIX my: <{mine}> PREFIX its: <{its}> "
    for text in ("'Z'", "'7'", "'X1'"):
        statements = statements.replace(text, f"'{owner}'")
    return f"{PREFIXES}{own} INSERT DATA {{ {statements.replace(ME, f'<{its}self>')} }}"


def test_five_robots_state_what_is_theirs_after_a_sixth_spoke_first(tmp_path: Path) -> None:
    with rtask.open(tmp_path / "kb", base=BASE) as kb:
        kb.update(f"{PREFIXES} INSERT DATA {{ GRAPH <urn:lab/axioms> {{ {AXIOMS} }} }}")
    tokens = TokenStore(tmp_path / "kb")
    who = {name: bearer(tokens.create("robot", agent=name)[0]) for name in (HOSTILE, *VICTIMS)}
    tokens.close()
    with running_server(tmp_path / "kb", "--write-rate", "100000") as server:

        def send(name: str, text: str) -> httpx.Response:
            headers = who[name] | {"Content-Type": "application/sparql-update"}
            return httpx.post(server.url + "/update", content=text, headers=headers, timeout=120)

        for name in VICTIMS:
            for kind, (theirs, _) in CASES.items():
                assert send(HOSTILE, update(name, kind, theirs)).status_code == 204
        answers: dict[tuple[str, str], httpx.Response] = {}

        def state_own(name: str) -> None:
            for kind, (_, own) in CASES.items():
                answers[name, kind] = send(name, update(name, kind, own))

        threads = [threading.Thread(target=state_own, args=(name,)) for name in VICTIMS]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        refused = {case: r.text for case, r in answers.items() if r.status_code != 204}
        assert (len(answers), refused) == (len(VICTIMS) * len(CASES), {})
        told = answers["nao-1", "functional data"].headers["RTASK-Remark"]
        assert HOSTILE in told
        for kind, (theirs, _) in CASES.items():
            again = send(HOSTILE, update("nao-1", kind, theirs))
            assert again.status_code == 403, (kind, again.text)
        harmless = send(HOSTILE, "INSERT DATA { <urn:x> <urn:p> 1 }")
        assert "in quarantine" in harmless.headers["RTASK-Remark"]
        same = "ASK { ?a <http://www.w3.org/2002/07/owl#sameAs> ?b FILTER(?a != ?b) }"
        answer = httpx.get(server.url + "/query", params={"query": same}, headers=who["nao-1"])
        assert answer.json()["boolean"] is False
