"""Home page: counts, the benefit of sharing, the workbench, objects, robots and the last events."""

from __future__ import annotations

from endpoint.pages.activity import last_events
from endpoint.pages.graph.workbench import DEFAULT_QUERY, samples
from endpoint.pages.learning import MAX_ATTEMPTS, benefit, recent_attempts
from endpoint.pages.objects import list_objects
from endpoint.pages.render import Model, current_request, knowledge_base, page, select
from endpoint.pages.robots import list_robots
from rtask import __version__

SHOWN_OBJECTS = 12
SHOWN_EVENTS = 6


@page("/", "home.html", twin="/index.json")
def home() -> Model:
    """Return counts, the benefit of sharing, objects, robots and the last events; four queries."""
    site = current_request().site
    counts = select("counts")[0]
    # Of more attempts than that, reading all of them would be what makes the page slow.
    is_small = int(counts["attempts"]) <= MAX_ATTEMPTS
    robots, all_robots = list_robots()
    return {
        "version": __version__,
        "base": knowledge_base().base,
        "counts": counts,
        "benefit": benefit(recent_attempts()) if is_small else None,
        "objects": list_objects(limit=SHOWN_OBJECTS),
        "robots": robots,
        "all_robots": all_robots,
        "events": last_events(SHOWN_EVENTS),
        "addresses": {
            "sparql": f"{site}/sparql",
            "graph_store": f"{site}/store",
            "operations": f"{site}/engine/",
            "robots": site.replace("http", "ws", 1) + "/",
        },
        "query": DEFAULT_QUERY,
        "samples": samples(),
    }
