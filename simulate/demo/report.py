"""The report of a demo: one row per object and robot, totals, and pictures."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from simulate.demo.queries import Answer, with_prefixes

__all__ = ["COLUMNS", "mean_attempts", "robot_totals", "rows", "summary", "write_report"]

COLUMNS = (
    "robot", "object", "recognised as", "conf.", "right", "grasp from", "told", "attempts", "held",
    "placed", "reason", "look s", "ask s", "plan s", "move s",
)  # fmt: skip


def rows(robots: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    """Return the table: one row per object and robot, in the order they were handled."""
    table = []
    for robot in robots:
        for met in robot["encounters"]:
            table.append(
                (
                    robot["name"],
                    met["product"] or "?",
                    met["label"] or ("known" if met["recognised"] else "new"),
                    f"{met['confidence']:.2f}",
                    {True: "yes", False: "NO", None: "-"}[met["right"]],
                    _first_source(met),
                    _told(met),
                    str(met["tries"]),
                    "yes" if met["held"] else "no",
                    "yes" if met["placed"] else "no",
                    met["attempts"][-1]["reason"] if met["attempts"] else "gone",
                    *(f"{_total(met, key):.2f}" for key in ("look", "ask", "plan", "move")),
                )
            )
    return table


def _first_source(met: Mapping[str, Any]) -> str:
    """Return the source of the first grasp; ``-`` without an attempt."""
    return str(met["attempts"][0]["source"]) if met["attempts"] else "-"


def _told(met: Mapping[str, Any]) -> str:
    """Return the statistics that the graph gave for the first grasp; ``-`` without any."""
    held, lost = met["attempts"][0].get("told", (0.0, 0.0)) if met["attempts"] else (0.0, 0.0)
    return f"{held:.1f} : {lost:.1f}" if max(held, lost) >= 0.05 else "-"


def _total(met: Mapping[str, Any], key: str) -> float:
    return float(sum(attempt["seconds"].get(key, 0.0) for attempt in met["attempts"]))


def by_product(encounters: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Join the encounters with the same product, as with one that was lost and found again."""
    joined: list[dict[str, Any]] = []
    first: dict[str, dict[str, Any]] = {}
    for met in encounters:
        known = first.get(met["product"]) if met["product"] else None
        if known is None:
            joined.append(dict(met))
            first[met["product"]] = joined[-1]
            continue
        if known["tries_to_success"] is None and met["tries_to_success"] is not None:
            known["tries_to_success"] = known["tries"] + met["tries_to_success"]
        known["tries"] += met["tries"]
        known["held"] |= met["held"]
        known["placed"] |= met["placed"]
        known["attempts"] = [*known.get("attempts", ()), *met.get("attempts", ())]
        if met.get("right") is False:  # trials of single objects know no identities
            known["right"] = False
    return joined


def mean_attempts(encounters: Sequence[Mapping[str, Any]], cap: int) -> float | None:
    """Return the mean number of physical attempts up to the first success.

    Over the objects in reach that were tried; one never held counts ``cap`` + 1. None when nothing
    was tried.
    """
    tried = [met for met in encounters if met["in_reach"] and met["tries"]]
    counts = [met["tries_to_success"] or cap + 1 for met in tried]
    return sum(counts) / len(counts) if counts else None


def own_judgements(encounters: Sequence[Mapping[str, Any]]) -> tuple[int, int]:
    """Return how many of the robot's judgements were right, and how many there were.

    Each physical attempt has two: whether the object was held and whether it was placed.
    """
    attempts = [a for met in encounters for a in met["attempts"] if a.get("truth")]
    right = sum(a[what] == a["truth"][what] for a in attempts for what in ("held", "placed"))
    return right, 2 * len(attempts)


def robot_totals(robot: Mapping[str, Any], cap: int) -> dict[str, Any]:
    """Return the totals of one robot, as ``rtask demo --json`` prints them."""
    objects = by_product(robot["encounters"])
    reach = [met for met in objects if met["in_reach"]]
    right, judged = own_judgements(objects)
    return {
        "name": robot["name"],
        "objects": len(objects),
        "objects_on_table": robot["objects_on_table"],
        "objects_in_reach": len(reach),
        "known_before": robot["known_before"],
        "recognised": sum(met["right"] is True for met in objects),
        "false_identities": sum(met["right"] is False for met in objects),
        "held": sum(met["held"] for met in reach),
        "placed": sum(met["placed"] for met in reach),
        "judgements": judged,
        "judgements_right": right,
        "from_memory": sum(_first_source(met) == "memory" for met in reach),
        "mean_attempts_to_first_success": mean_attempts(objects, cap),
        "seconds": round(robot["seconds"], 2),
    }


def summary(
    robots: Sequence[Mapping[str, Any]], cap: int, store: Path, url: str, seed: int
) -> dict[str, Any]:
    """Return the one object that ``rtask demo --json`` prints."""
    objects = [{"robot": robot["name"], **met} for robot in robots for met in robot["encounters"]]
    return {
        "robots": [robot_totals(robot, cap) for robot in robots],
        "objects": objects,
        "store": str(store),
        "url": url,
        "seed": seed,
    }


def write_report(
    folder: Path,
    result: Mapping[str, Any],
    table: Sequence[Sequence[str]],
    answers: Sequence[Answer],
) -> None:
    """Write ``report.json`` and ``report.md`` beside the pictures that the robots took."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "report.json").write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    lines = ["# What the robots did", "", *_markdown(COLUMNS, table), "", "## Totals", ""]
    names = [key for key in result["robots"][0] if key != "name"] if result["robots"] else []
    lines += _markdown(
        ("", *(robot["name"] for robot in result["robots"])),
        [(name.replace("_", " "), *(_show(r[name]) for r in result["robots"])) for name in names],
    )
    for answer in answers:
        lines += ["", f"## {answer.question.words}", "", "```sparql"]
        lines += [with_prefixes(answer.question.sparql).rstrip(), "```", ""]
        lines += _markdown(answer.columns, answer.rows)
    lines += _pictures(folder, result)
    (folder / "report.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _pictures(folder: Path, result: Mapping[str, Any]) -> list[str]:
    """Return Markdown with the pictures of each attempt under its object and outcome."""
    lines: list[str] = []
    for met in result.get("objects", ()):
        for attempt in met["attempts"]:
            run = attempt.get("run", 0)
            found = sorted((folder / met["robot"]).glob(f"{run:02d}-*.png")) if run else []
            if not found:
                continue
            known = f"known as {met['label'] or 'an object'}" if met["recognised"] else "new"
            came = attempt["place_reason"] if attempt["held"] else attempt["reason"]
            said = "held and placed" if attempt["placed"] else f"not {_missing(attempt)}: {came}"
            lines += ["", f"### {met['robot']}: {met['product']}, {known}; {said}", ""]
            lines += _markdown(
                [path.stem.split("-")[-1].replace("_", " ") for path in found],
                [[f"![{path.stem}]({path.parent.name}/{path.name})" for path in found]],
            )
    return ["", "## Pictures", *lines] if lines else []


def _missing(attempt: Mapping[str, Any]) -> str:
    return "placed" if attempt["held"] else "held"


def _show(value: object) -> str:
    if value is None:
        return "-"
    return f"{value:.2f}" if isinstance(value, float) else str(value)


def _markdown(columns: Sequence[str], table: Sequence[Sequence[str]]) -> list[str]:
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    return lines + ["| " + " | ".join(row) + " |" for row in table]
