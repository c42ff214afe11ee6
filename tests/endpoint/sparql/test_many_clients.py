"""Many clients at once: exactly what is acknowledged is stored, and nothing fails."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import httpx
import pytest

from tests.servers import running_server

MUG = "a <https://w3id.org/rtask-kg/ns#Mug>"
A_THING = "a <http://purl.org/ieee1872-owl/sumo-cora#Object>"
COUNT_UP = """
DELETE {{ ?s {0} ?n }} INSERT {{ <urn:counter> {0} ?next }}
WHERE {{ OPTIONAL {{ ?s {0} ?n }} BIND (COALESCE(?n, 0) + 1 AS ?next) }}
"""
UPDATE = {"Content-Type": "application/sparql-update"}


class Client:
    """A client that reads and writes by chance.

    Attributes
    ----------
    stored, counted
        How many of its inserts, and of its updates of the common counter, were acknowledged.
    answers
        Status codes of all answers.
    """

    def __init__(self, url: str, crowd: int, number: int) -> None:
        self._by, self._count = f"<urn:by-{crowd}>", f"<urn:count-{crowd}>"
        self.number, self.stored, self.counted = number, 0, 0
        self.answers: Counter[int] = Counter()
        self._chance = random.Random(number)
        self._http = httpx.Client(base_url=url, timeout=120)

    def run(self, steps: int) -> None:
        """Take steps, each of one request or two."""
        with self._http:
            for step in range(steps):
                kind = self._chance.choice(("insert", "insert", "count up", "count", "look up"))
                if kind == "insert":
                    self._insert(f"<urn:{self.number}:{step}>")
                elif kind == "count up":
                    self.counted += self._update(COUNT_UP.format(self._count))
                elif kind == "count":
                    self._ask(f"SELECT (COUNT(?s) AS ?n) {{ ?s {self._by} ?b }}")
                else:
                    self._ask(f"SELECT ?s {{ ?s {self._by} {self.number} }} # {step}")

    def _insert(self, name: str) -> None:
        if self._update(f"INSERT DATA {{ {name} {MUG} ; {self._by} {self.number} }}"):
            self.stored += 1
            seen = self._ask(f"ASK {{ {name} {self._by} {self.number} ; {A_THING} }}")
            assert seen is not False, f"{name} was acknowledged and is not there"

    def _update(self, text: str) -> bool:
        answer = self._http.post("/update", content=text, headers=UPDATE)
        self.answers[answer.status_code] += 1
        return answer.is_success

    def _ask(self, text: str) -> bool | None:
        """Return the answer to an ASK; None for other queries and from a server too busy."""
        accepted = {"Accept": "application/sparql-results+json"}
        answer = self._http.post("/query", data={"query": text}, headers=accepted)
        self.answers[answer.status_code] += 1
        return answer.json().get("boolean") if answer.is_success else None


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of a server without tokens."""
    with running_server(tmp_path_factory.mktemp("many") / "store") as server:
        yield server.url


@pytest.mark.parametrize(("count", "steps"), [(8, 5), pytest.param(64, 6, marks=pytest.mark.deep)])
def test_many_clients_lose_nothing_and_break_nothing(url: str, count: int, steps: int) -> None:
    clients = [Client(url, count, number) for number in range(count)]
    with ThreadPoolExecutor(count) as pool:
        list(pool.map(lambda each: each.run(steps), clients))
    answers = sum((each.answers for each in clients), Counter())
    # A machine without time for a request says so; what it did not acknowledge, it did not do.
    assert set(answers) - {503, 504} == {200, 204}
    assert answers[503] + answers[504] < answers.total() / 20
    asked = {"query": f"SELECT (COUNT(?s) AS ?n) {{ ?s <urn:by-{count}> ?b }}"}
    stored = httpx.get(f"{url}/query", params=asked).json()["results"]["bindings"]
    assert stored[0]["n"]["value"] == str(sum(each.stored for each in clients))
    asked = {"query": f"SELECT ?n {{ ?s <urn:count-{count}> ?n }}"}
    counted = httpx.get(f"{url}/query", params=asked).json()["results"]["bindings"]
    assert [row["n"]["value"] for row in counted] == [str(sum(c.counted for c in clients))]
