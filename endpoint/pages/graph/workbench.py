"""SPARQL workbench for people, at the address of the protocol."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import flask

import ontology
from endpoint.http.problems import PROBLEM_TYPE
from endpoint.pages.render import (
    Model,
    application,
    blueprint,
    context,
    current_request,
    knowledge_base,
)
from endpoint.sparql.negotiation import RESULTS_JSON, TURTLE

_EDITOR = Path(__file__).parent.parent / "static" / "vendor" / "editor.js"
_EXAMPLE = "https://w3id.org/rtask-kg/kb/sample/"
"""What starts the individuals of ``ontology/examples/sample.trig``."""
MAX_ROWS = 1_000
MAX_TEXT = 200_000
DEFAULT_QUERY = f"""PREFIX rt: <{ontology.NS}>

SELECT ?object ?name (COUNT(DISTINCT ?attempt) AS ?attempts) (COUNT(DISTINCT ?win) AS ?held)
WHERE {{
  ?object a rt:ManipulableObject ; rt:name ?name .
  OPTIONAL {{
    ?object rt:hasGrasp/rt:triedIn ?attempt .
    OPTIONAL {{ ?attempt rt:hasOutcome ?o . ?o rt:judgedSuccess true BIND(?attempt AS ?win) }}
  }}
}}
GROUP BY ?object ?name
ORDER BY DESC(?attempts)
LIMIT 100
"""


@blueprint.app_context_processor
def _editor() -> dict[str, object]:
    """Tell templates whether the library of the query editor was bundled at set-up."""
    return {"has_editor": _EDITOR.exists}


def samples() -> list[dict[str, str]]:
    """Return the competency questions of the ontology, each with its query.

    Those about individuals of the ontology's example are left out of a graph without it: they
    would answer nothing.
    """
    about_example = knowledge_base().select(f"SELECT ?p {{ <{_EXAMPLE}mug> ?p ?o }} LIMIT 1")
    return [each for each in _questions() if about_example or _EXAMPLE not in each["query"]]


@cache
def _questions() -> list[dict[str, str]]:
    examples = []
    for path in ontology.queries():
        lines = path.read_text(encoding="utf-8").splitlines()
        questions = [line[11:].strip() for line in lines if line.startswith("# question:")]
        query = "\n".join(line for line in lines if not line.startswith("# ")).strip()
        examples.append({"question": " ".join(questions) or path.stem, "query": query})
    return examples


@blueprint.route("/sparql", methods=["GET"])
def workbench() -> str:
    """Show the workbench; ``?query=`` opens it filled in and run."""
    query = flask.request.args.get("query", "")
    model: Model = {
        "query": query or DEFAULT_QUERY,
        "samples": samples(),
        "base": context().kb.base,
        "answer": run(query) if query else None,
    }
    return flask.render_template("sparql.html", **model)


def run(query: str) -> dict[str, Any]:
    """Run a query as any program would, and return what the page shows of the answer."""
    request = current_request()
    # The answer is read here: what the browser can decompress is of no use.
    sent = {name: text for name, text in request.headers.items() if name != "accept-encoding"}
    asked = replace(
        request,
        method="GET",
        query_string=urlencode({"query": query}),
        headers={**sent, "accept": f"{RESULTS_JSON}, {TURTLE}"},
    )
    started = time.perf_counter()
    response = application().handle(asked)
    answer: dict[str, Any] = {"seconds": time.perf_counter() - started}
    if response.media_type == PROBLEM_TYPE:
        return {**answer, "problem": json.loads(response.body)}
    if response.media_type != RESULTS_JSON:
        text = response.body.decode()
        return {**answer, "text": text[:MAX_TEXT], "left_out": max(0, len(text) - MAX_TEXT)}
    document = json.loads(response.body)
    if "boolean" in document:
        return {**answer, "boolean": document["boolean"]}
    rows = document["results"]["bindings"]
    return {
        **answer,
        "variables": document["head"]["vars"],
        "rows": rows[:MAX_ROWS],
        "total": len(rows),
    }
