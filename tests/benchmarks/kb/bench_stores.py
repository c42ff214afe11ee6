"""A knowledge base in memory, in a folder, and on SPARQL servers: opening, commits, reads.

    .venv/bin/python tests/benchmarks/kb/bench_stores.py [--commits 200]

Each server runs on this machine, with its data on disk and as it comes from the package. Opening
loads the ontology that comes with RTASK and derives what follows from it. A commit states three
facts about a new object in one robot's graph, with reasoning and records. "Again" is a second
opening with its first commit, for which the saved closure is read. Times are those of the
caller; the servers' own work is part of them.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import ontology
import rtask
from rtask.knowledge_base import KnowledgeBase
from rtask.rdf.terms import RDF_TYPE, iri
from rtask.remote.store import RemoteStore
from tests import sparql_servers
from tests.sparql_servers import Oxigraph, SparqlServer, Virtuoso

_READS = (
    ("one object", "SELECT ?p ?o { <urn:o7> ?p ?o }"),
    ("join", f"SELECT ?s {{ ?s a <{ontology.NS}Mug> ; <urn:mass> ?m FILTER(?m > 100) }} LIMIT 20"),
    ("count all", "SELECT (COUNT(*) AS ?n) { ?s ?p ?o }"),
)


def _ms(function: Callable[[], Any], times: int) -> float:
    taken = []
    for _ in range(times):
        started = time.perf_counter()
        function()
        taken.append(time.perf_counter() - started)
    return 1e3 * statistics.median(taken)


def _measure(name: str, target: Any, commits: int, **options: Any) -> None:
    started = time.perf_counter()
    kb = rtask.open(target, **options)
    assert isinstance(kb, KnowledgeBase)
    opened = time.perf_counter() - started
    with kb:
        numbers = iter(range(10 * commits))

        def commit() -> None:
            number = next(numbers)
            with kb.transaction(agent="nao-1") as tx:
                tx.add(f"urn:o{number}", RDF_TYPE, iri(ontology.NS + "Mug"))
                tx.add(f"urn:o{number}", "urn:mass", number)
                tx.add(f"urn:o{number}", "urn:name", f"mug {number}")

        commit()
        connection = kb.store.endpoints.connection if isinstance(kb.store, RemoteStore) else None
        before = connection.requests if connection else 0
        each = _ms(commit, commits)
        requests = (connection.requests - before) / commits if connection else 0.0
        reads = [_ms(lambda text=text: kb.select(text), 20) for _, text in _READS]
    cells = [f"{opened:8.1f}", f"{each:9.2f}", f"{requests:9.1f}", *(f"{r:11.2f}" for r in reads)]
    if target != ":memory:":
        started = time.perf_counter()
        with rtask.open(target, **options) as again:
            again.update("INSERT DATA { <urn:last> <urn:mass> 1 }", "nao-1")
            cells.append(f"{time.perf_counter() - started:9.2f}")
    print(f"{name:16}", *cells, flush=True)


def _on_server(server: SparqlServer, name: str, commits: int, root: Path) -> None:
    server.start()
    try:
        _measure(name, server.address, commits, folder=root / f"local-{name}")
    finally:
        server.kill()


def main() -> None:
    """Print a line for each place."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--commits", type=int, default=200)
    commits = parser.parse_args().commits
    print(f"{commits} commits, load {os.getloadavg()[0]:.1f}")
    print(
        f"{'':16} open, s  commit, ms requests",
        *(f"{n + ', ms':>11}" for n, _ in _READS),
        "again, s",
    )
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        if sparql_servers.VIRTUOSO is not None:
            _on_server(Virtuoso(root / "virtuoso"), "virtuoso", commits, root)
        if sparql_servers.OXIGRAPH is not None:
            _on_server(Oxigraph(root / "oxigraph"), "oxigraph serve", commits, root)
        _measure("folder", root / "folder", commits)
        _measure("memory", ":memory:", commits)


if __name__ == "__main__":
    main()
