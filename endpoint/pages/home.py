"""Home page (counts, the workbench, objects and robots) and the page about robots."""

from __future__ import annotations

from endpoint.pages.graph.workbench import DEFAULT_QUERY, samples
from endpoint.pages.objects import list_objects
from endpoint.pages.render import Model, current_request, knowledge_base, page, select
from rtask import __version__

SHOWN_OBJECTS = 24


@page("/", "home.html", twin="/index.json")
def home() -> Model:
    """Return counts, objects and robots; three queries."""
    site = current_request().site
    return {
        "version": __version__,
        "base": knowledge_base().base,
        "counts": select("counts")[0],
        "objects": list_objects(limit=SHOWN_OBJECTS),
        "robots": list_robots(),
        "addresses": {
            "sparql": f"{site}/sparql",
            "graph_store": f"{site}/store",
            "operations": f"{site}/engine/",
            "robots": site.replace("http", "ws", 1) + "/",
        },
        "query": DEFAULT_QUERY,
        "samples": samples(),
    }


def list_robots() -> list[Model]:
    """Return each robot with its last outcome."""
    rows: dict[str, Model] = {}
    for row in select("robots"):
        robot = str(row["robot"])
        row["attempts"] = int(row.get("attempts") or 0)
        row["successes"] = int(row.get("successes") or 0)
        row["mean"] = row["successes"] / row["attempts"] if row["attempts"] else None
        rows.setdefault(robot, row)
    return list(rows.values())


@page("/robots", "robots.html")
def robots() -> Model:
    """Return all robots; one query."""
    return {"robots": list_robots()}
