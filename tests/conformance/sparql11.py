"""Run the W3C's SPARQL 1.1 evaluation and syntax cases against a server, over HTTP.

    python sparql11.py URL FOLDER [--json FILE]

URL is a throw-away server with a plain dataset (it is erased before each case), FOLDER the
`sparql11` folder of w3c/rdf-tests. Cases of entailment and SERVICE are left out. Results are
compared up to blank nodes and by the value of numbers, as multisets of rows. Since the store keeps
values and not spellings (`"01"` becomes `"1"`), cases whose answer is also spelt as expected are
counted apart: `as_written`.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote, unquote, urlsplit

import httpx
import pyoxigraph as ox

from rtask.rdf.terms import stored

PREFIXES = """
PREFIX mf: <http://www.w3.org/2001/sw/DataAccess/tests/test-manifest#>
PREFIX qt: <http://www.w3.org/2001/sw/DataAccess/tests/test-query#>
PREFIX ut: <http://www.w3.org/2009/sparql/tests/test-update#>
PREFIX rdfs: <http://www.w3.org/2000/01/rdf-schema#>
"""
RESULT_SET = "PREFIX rs: <http://www.w3.org/2001/sw/DataAccess/tests/result-set#>"
LEFT_OUT = ("entailment", "service")
ROWS_JSON = "application/sparql-results+json"
N_TRIPLES, N_QUADS = "application/n-triples", "application/n-quads"
ROW, VALUE = "urn:row:", "urn:value:"

QUERY_CASES = """SELECT ?case ?kind ?action ?query ?result {
  VALUES ?kind { mf:QueryEvaluationTest mf:CSVResultFormatTest }
  ?case a ?kind ; mf:action ?action ; mf:result ?result . ?action qt:query ?query
} ORDER BY ?case"""
QUERY_DATA = """SELECT ?file ?name {
  { ?action qt:data ?file }
  UNION { ?action qt:graphData ?file FILTER(isIRI(?file)) BIND(?file AS ?name) }
  UNION { ?action qt:graphData ?node . ?node qt:graph ?file ; rdfs:label ?name }
}"""
UPDATE_CASES = """SELECT ?case ?action ?result ?request {
  ?case a mf:UpdateEvaluationTest ; mf:action ?action ; mf:result ?result .
  ?action ut:request ?request
} ORDER BY ?case"""
UPDATE_DATA = """SELECT ?file ?name {
  { ?action ut:data ?file } UNION { ?action ut:graphData [ ut:graph ?file ; rdfs:label ?name ] }
}"""
SYNTAX_CASES = """SELECT ?case ?file ?update ?good {
  VALUES (?kind ?update ?good) {
    (mf:PositiveSyntaxTest11 false true) (mf:NegativeSyntaxTest11 false false)
    (mf:PositiveUpdateSyntaxTest11 true true) (mf:NegativeUpdateSyntaxTest11 true false)
  }
  ?case a ?kind ; mf:action ?file
} ORDER BY ?case"""


class Match(NamedTuple):
    """Whether an answer is the expected one: literals by value, and as they are written."""

    by_value: bool
    as_written: bool

    @classmethod
    def of(cls, compare: Callable[[bool], bool]) -> Match:
        """Compare twice; the argument of the comparison says whether spelling counts."""
        return cls(compare(False), compare(True))


class Suite:
    """The cases of one folder against one server.

    Parameters
    ----------
    url
        Scheme and authority of the server.
    folder
        Holds one folder a subject, each with ``manifest.ttl``.
    """

    def __init__(self, url: str, folder: Path) -> None:
        self.client = httpx.Client(base_url=url, timeout=60)
        self.manifests = ox.Store()
        self.groups: dict[str, dict[str, Any]] = {}
        for manifest in sorted(folder.glob("*/manifest.ttl")):
            if manifest.parent.name not in LEFT_OUT:
                self.manifests.load(
                    path=manifest, format=ox.RdfFormat.TURTLE, base_iri=manifest.as_uri()
                )

    def run(self) -> dict[str, dict[str, Any]]:
        """Run all cases; returns passed, total and the failed ones of each group."""
        for row in self._select(QUERY_CASES):
            is_csv = row["kind"].value.endswith("CSVResultFormatTest")
            group = "CSV results" if is_csv else "query evaluation"
            self._record(
                group, row["case"], lambda row=row, is_csv=is_csv: self._query(row, is_csv)
            )
        for row in self._select(UPDATE_CASES):
            self._record("update evaluation", row["case"], lambda row=row: self._update(row))
        for row in self._select(SYNTAX_CASES):
            update = row["update"].value == "true"
            group = f"{'update' if update else 'query'} syntax"
            self._record(group, row["case"], lambda row=row, u=update: self._syntax(row, u))
        return self.groups

    def _select(self, text: str, **terms: Any) -> list[Any]:
        fixed = {ox.Variable(name): term for name, term in terms.items()}
        query = PREFIXES + text
        for variable, term in fixed.items():
            query = query.replace(f"?{variable.value} ", f"{term} ")
        return list(self.manifests.query(query))  # type: ignore[arg-type]

    def _record(self, group: str, case: ox.NamedNode, test: Callable[[], Match]) -> None:
        counts = self.groups.setdefault(
            group, {"passed": 0, "as_written": 0, "total": 0, "failed": [], "why": {}}
        )
        counts["total"] += 1
        try:
            passed = test()
        except (AssertionError, ValueError, SyntaxError, KeyError) as error:
            passed = Match(False, False)
            counts["why"][case.value] = f"{type(error).__name__}: {error}"[:300]
        counts["as_written"] += passed.as_written
        if passed.by_value:
            counts["passed"] += 1
        else:
            path = Path(unquote(urlsplit(case.value).path))
            subject = path.parent.name if path.name.startswith("manifest") else path.name
            counts["failed"].append(f"{subject}/{urlsplit(case.value).fragment}")

    def _fill(self, files: Iterable[tuple[Path, str]]) -> None:
        """Empty the store and load files, each into its graph (empty: the default graph)."""
        self.client.post("/update", data={"update": "DROP ALL"}).raise_for_status()
        for path, graph in files:
            where = f"graph={quote(graph, safe='')}" if graph else "default"
            answer = self.client.post(
                f"/store?{where}", content=_triples(path), headers={"Content-Type": N_TRIPLES}
            )
            assert answer.status_code in (201, 204), answer.text

    def _files(self, text: str, action: ox.NamedNode | ox.BlankNode) -> list[tuple[Path, str]]:
        if isinstance(action, ox.BlankNode):
            rows = self._data_of(text, action)
        else:
            rows = self._select(text, action=action)
        return [(_path(row["file"]), row["name"].value if row["name"] else "") for row in rows]

    def _data_of(self, text: str, action: ox.BlankNode) -> list[Any]:
        """Ask about a blank node, which no query text can name."""
        query = PREFIXES + text.replace("SELECT ?file ?name", "SELECT ?action ?file ?name")
        rows = self.manifests.query(query)
        return [row for row in rows if row["action"] == action]  # type: ignore[union-attr]

    def _query(self, row: Any, is_csv: bool) -> Match:
        self._fill(self._files(QUERY_DATA, row["action"]))
        text, expected = _with_base(_path(row["query"])), _path(row["result"])
        if is_csv:
            got_csv, csv_wanted = self._ask(text, "text/csv").text, expected.read_text("utf-8")
            return Match.of(lambda exact: _table(got_csv, exact) == _table(csv_wanted, exact))
        if expected.suffix in (".ttl", ".rdf", ".nt") and not _is_result_set(expected):
            answer = self._ask(text, N_TRIPLES)
            got = list(ox.parse(answer.content, format=ox.RdfFormat.N_TRIPLES))
            return _compare(got, _quads(expected))
        answer = self._ask(text, ROWS_JSON)
        got_rows = ox.parse_query_results(answer.content, format=ox.QueryResultsFormat.JSON)
        if _is_result_set(expected):
            names, quads = _result_set(expected)
        else:
            names, quads = _rows(ox.parse_query_results(path=expected))
        got_names, got_quads = _rows(got_rows)
        return _compare(got_quads, quads) if got_names == names else Match(False, False)

    def _ask(self, text: str, accept: str) -> httpx.Response:
        answer = self.client.post("/query", data={"query": text}, headers={"Accept": accept})
        assert answer.status_code == 200, answer.text
        return answer

    def _update(self, row: Any) -> Match:
        self._fill(self._files(UPDATE_DATA, row["action"]))
        text = _with_base(_path(row["request"]))
        answer = self.client.post("/update", data={"update": text})
        assert answer.status_code == 204, answer.text
        whole = self.client.get("/store", headers={"Accept": N_QUADS})
        got = list(ox.parse(whole.content, format=ox.RdfFormat.N_QUADS))
        wanted = []
        for path, graph in self._files(UPDATE_DATA, row["result"]):
            where = ox.NamedNode(graph) if graph else ox.DefaultGraph()
            wanted += [ox.Quad(q.subject, q.predicate, q.object, where) for q in _quads(path)]
        return _compare(got, wanted)

    def _syntax(self, row: Any, update: bool) -> Match:
        self.client.post("/update", data={"update": "DROP ALL"}).raise_for_status()
        text = _with_base(_path(row["file"]))
        address, field = ("/update", "update") if update else ("/query", "query")
        answer = self.client.post(address, data={field: text})
        assert answer.status_code < 500, answer.text
        passed = (answer.status_code != 400) == (row["good"].value == "true")
        return Match(passed, passed)


def _path(term: ox.NamedNode) -> Path:
    return Path(unquote(urlsplit(term.value).path))


def _with_base(path: Path) -> str:
    """Return a query or update whose relative IRIs mean what they mean in its file."""
    return f"BASE <{path.as_uri()}>\n{path.read_text('utf-8')}"


def _quads(path: Path) -> list[ox.Quad]:
    return list(ox.parse(path=path, base_iri=path.as_uri(), rename_blank_nodes=True))


def _triples(path: Path) -> bytes:
    triples = [quad.triple for quad in _quads(path)]
    written = ox.serialize(triples, format=ox.RdfFormat.N_TRIPLES)
    assert written is not None
    return written


def _compare(got: list[ox.Quad], wanted: list[ox.Quad]) -> Match:
    return Match.of(lambda exact: _canonical(got, exact) == _canonical(wanted, exact))


def _canonical(quads: Iterable[ox.Quad], exact: bool) -> set[str]:
    """Return quads with blank nodes named by their place; unless exact, literals as stored."""
    dataset = ox.Dataset(
        q if exact else ox.Quad(q.subject, q.predicate, stored(q.object), q.graph_name)
        for q in quads
    )
    dataset.canonicalize(ox.CanonicalizationAlgorithm.UNSTABLE)
    return {str(quad) for quad in dataset}


def _rows(results: Any) -> Any:
    """Return the names of columns, and rows as statements about blank nodes."""
    if isinstance(results, ox.QueryBoolean):
        return str(bool(results)), []
    names = [variable.value for variable in results.variables]
    quads = []
    for number, row in enumerate(results):
        node = ox.BlankNode(f"row{number}")
        quads.append(ox.Quad(node, ox.NamedNode(ROW), ox.Literal("")))
        for name, term in zip(names, row, strict=True):
            if term is not None:
                quads.append(ox.Quad(node, ox.NamedNode(VALUE + name), term))
    return sorted(names), quads


def _is_result_set(path: Path) -> bool:
    """Tell whether a file of triples describes rows instead of being a graph."""
    return path.suffix in (".ttl", ".rdf") and "result-set#" in path.read_text("utf-8")


def _result_set(path: Path) -> Any:
    """Read rows that are written as triples (the DAWG's result-set vocabulary)."""
    store = ox.Store()
    store.extend(_quads(path))
    heads = store.query(f"{RESULT_SET} SELECT ?name {{ ?set rs:resultVariable ?name }}")
    names = sorted(row["name"].value for row in heads)  # type: ignore[union-attr]
    cells = store.query(f"""{RESULT_SET} SELECT ?row ?name ?value {{
      ?set rs:solution ?row
      OPTIONAL {{ ?row rs:binding [ rs:variable ?name ; rs:value ?value ] }} }}""")
    quads = []
    for cell in cells:  # type: ignore[union-attr]
        quads.append(ox.Quad(cell["row"], ox.NamedNode(ROW), ox.Literal("")))
        if cell["name"]:
            name = ox.NamedNode(VALUE + cell["name"].value)
            quads.append(ox.Quad(cell["row"], name, cell["value"]))
    return names, quads


def _table(text: str, exact: bool) -> list[list[tuple[str, str]]]:
    """Return rows by column name, for `SELECT *` fixes no order; unless exact, numbers by value."""
    labels: dict[str, str] = {}

    def cell(value: str) -> str:
        if value.startswith("_:"):
            return labels.setdefault(value, f"_:{len(labels)}")
        try:
            return value if exact else repr(float(value))
        except ValueError:
            return value

    rows = csv.DictReader(io.StringIO(text))
    return sorted(sorted((name, cell(value)) for name, value in row.items()) for row in rows)


def main() -> int:
    """Run the cases and print one line a group."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("url")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    groups = Suite(options.url, options.folder).run()
    for name, counts in groups.items():
        sys.stdout.write(
            f"{name}: {counts['passed']} of {counts['total']}, "
            f"{counts['as_written']} with literals as written\n"
        )
    if options.json:
        options.json.write_text(json.dumps(groups, indent=1), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
