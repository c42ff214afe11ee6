"""Page about robots: model, successes and last outcome."""

from __future__ import annotations

from endpoint.pages.render import Model, page, select


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
