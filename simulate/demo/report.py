"""The report of a demo: one row per object and robot, totals, and pictures."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rtask.kb.durability.settings import write_durably
from simulate.demo.products import by_product
from simulate.demo.queries import Answer, with_prefixes
from simulate.demo.report_attempts import attempt_pictures, phase_of
from simulate.demo.report_page import report_page

__all__ = [
    "COLUMNS",
    "NARROW",
    "attempts_to_success",
    "comparison",
    "mean_attempts",
    "robot_totals",
    "rows",
    "show_total",
    "summary",
    "write_report",
]

COLUMNS = (
    "robot", "object", "recognised as", "conf.", "right", "grasp from", "told", "attempts", "held",
    "placed", "reason", "look s", "ask s", "plan s", "move s",
)  # fmt: skip

NARROW = ("robot", "object", "recognised as", "attempts", "held", "placed")
"""The columns for a narrow terminal; the report has all."""


def rows(robots: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    """Return the table: one row per object and robot, in the order they were handled."""
    table = []
    for robot in robots:
        for encounter in robot["encounters"]:
            table.append(
                (
                    robot["name"],
                    encounter["product"] or "?",
                    encounter["label"] or ("known" if encounter["recognised"] else "new"),
                    f"{encounter['confidence']:.2f}",
                    {True: "yes", False: "NO", None: "-"}[encounter["right"]],
                    _first_source(encounter),
                    _encounter_row(encounter),
                    str(encounter["tries"]),
                    "yes" if encounter["held"] else "no",
                    "yes" if encounter["placed"] else "no",
                    _reason(encounter),
                    *(f"{_total(encounter, key):.2f}" for key in ("look", "ask", "plan", "move")),
                )
            )
    return table


def _first_source(encounter: Mapping[str, Any]) -> str:
    """Return the source of the first grasp; ``-`` without an attempt."""
    return str(encounter["attempts"][0]["source"]) if encounter["attempts"] else "-"


def _reason(encounter: Mapping[str, Any]) -> str:
    """Return the last reason code, or ``gone`` for what went out of sight and was not found."""
    lost = encounter.get("lost", False) or not encounter["attempts"]
    return "gone" if lost else str(encounter["attempts"][-1]["reason"])


def _encounter_row(encounter: Mapping[str, Any]) -> str:
    """Return the statistics that the graph gave for the first grasp; ``-`` without any."""
    held, lost = (
        encounter["attempts"][0].get("told", (0.0, 0.0)) if encounter["attempts"] else (0.0, 0.0)
    )
    return f"{held:.1f} : {lost:.1f}" if max(held, lost) >= 0.05 else "-"


def _total(encounter: Mapping[str, Any], key: str) -> float:
    return float(sum(attempt["seconds"].get(key, 0.0) for attempt in encounter["attempts"]))


def attempts_to_success(met: Mapping[str, Any], cap: int) -> int:
    """Return the attempts at an object up to the first success; ``cap`` + 1 if there was none.

    What was lost on the way and fell into the box leaves nothing to try again, though its grasp
    failed: it counts one more than the attempts that were made.
    """
    made = min(int(met["tries"]), cap) if met["placed"] else cap
    return int(met["tries_to_success"] or made + 1)


def mean_attempts(encounters: Sequence[Mapping[str, Any]], cap: int) -> float | None:
    """Return the mean of :func:`attempts_to_success` over the objects in reach that were tried.

    None if nothing was tried.
    """
    tried = [encounter for encounter in encounters if encounter["in_reach"] and encounter["tries"]]
    counts = [attempts_to_success(encounter, cap) for encounter in tried]
    return sum(counts) / len(counts) if counts else None


def own_judgements(encounters: Sequence[Mapping[str, Any]]) -> tuple[int, int]:
    """Return how many of the robot's judgements were right, and how many there were.

    Each physical attempt has two: whether the object was held and whether it was placed.
    """
    attempts = [a for encounter in encounters for a in encounter["attempts"] if a.get("truth")]
    right = sum(a[what] == a["truth"][what] for a in attempts for what in ("held", "placed"))
    return right, 2 * len(attempts)


def robot_totals(robot: Mapping[str, Any], cap: int) -> dict[str, Any]:
    """Return the totals of one robot, as ``rtask demo --json`` prints them."""
    objects = by_product(robot["encounters"])
    reach = [encounter for encounter in objects if encounter["in_reach"]]
    right, judged = own_judgements(objects)
    return {
        "name": robot["name"],
        "objects": len(objects),
        "objects_on_table": len(robot["products"]),
        "never_seen": sorted(set(robot["products"]) - {met["product"] for met in objects}),
        "objects_in_reach": len(reach),
        "known_before": robot["known_before"],
        "recognised": sum(encounter["right"] is True for encounter in objects),
        "false_identities": sum(encounter["right"] is False for encounter in objects),
        "false_objects": sum(met.get("false_object", False) for met in robot["encounters"]),
        "held": sum(encounter["held"] for encounter in reach),
        "placed": sum(encounter["placed"] for encounter in reach),
        "judgements": judged,
        "judgements_right": right,
        "succeeded_at_once": sum(encounter["tries_to_success"] == 1 for encounter in reach),
        "from_memory": sum(_first_source(encounter) == "memory" for encounter in reach),
        "mean_attempts_to_first_success": mean_attempts(objects, cap),
        "seconds": round(robot["seconds"], 2),
    }


def comparison(
    shared: Sequence[Mapping[str, Any]], apart: Sequence[Mapping[str, Any]]
) -> list[tuple[str, ...]]:
    """Return rows that set a robot's work with the graph beside that without it.

    Product, attempts to success with and without, source of the first grasp, and what the graph
    told of it.
    """
    alone = {row["product"]: row for row in by_product(apart)}
    return [
        (
            str(row["product"]),
            _attempts(row),
            _attempts(alone.get(row["product"])),
            _first_source(row),
            str(row["attempts"][0].get("alone", "")) if row["attempts"] else "",
        )
        for row in by_product(shared)
        if row["product"]
    ]


def _attempts(met: Mapping[str, Any] | None) -> str:
    """Return the attempts to success; with ``>`` if none of them succeeded."""
    if met is None or not met["tries"]:
        return "-"
    return str(met["tries_to_success"] or f"> {met['tries']}")


def summary(
    robots: Sequence[Mapping[str, Any]],
    cap: int,
    store: Path,
    url: str,
    seed: int,
    products: str,
    apart: Sequence[Mapping[str, Any]] = (),
    gains: Sequence[Mapping[str, Any]] = (),
    lessons: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Return the one object that ``rtask demo --json`` prints.

    Parameters
    ----------
    products
        Set of :data:`simulate.world.objects.PRODUCTS`.
    apart
        Work of some robots, such as the last, with a graph of their own.
    gains
        What sharing gained for these, as :meth:`simulate.demo.story.Gain.to_dict` returns it.
    lessons
        What the last robot recalled of the earlier robots' successes, as
        :meth:`simulate.demo.lessons.Lessons.to_dict` returns it.
    """
    objects = [met for robot in robots for met in _encounters(robot)]
    return {
        "robots": [robot_totals(robot, cap) for robot in robots],
        "objects": objects,
        "alone": robot_totals(apart[-1], cap) if apart else None,
        "alone_robots": [robot_totals(robot, cap) for robot in apart],
        "alone_objects": [met for robot in apart for met in _encounters(robot)],
        "gain": gains[-1] if gains else None,
        "gains": list(gains),
        "lessons": lessons,
        "store": str(store),
        "url": url,
        "seed": seed,
        "products": products,
    }


def _encounters(robot: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [{"robot": robot["name"], **encounter} for encounter in robot["encounters"]]


def write_report(
    folder: Path,
    result: Mapping[str, Any],
    table: Sequence[Sequence[str]],
    answers: Sequence[Answer],
) -> None:
    """Write ``report.json``, ``report.md`` and ``report.html`` beside the pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    write_durably(folder / "report.json", json.dumps(result, indent=2) + "\n")
    lines = ["# What the robots did", "", *_markdown(COLUMNS, table), "", "## Totals", ""]
    names = [key for key in result["robots"][0] if key != "name"] if result["robots"] else []
    lines += _markdown(
        ("", *(robot["name"] for robot in result["robots"])),
        [
            (name.replace("_", " "), *(show_total(r[name]) for r in result["robots"]))
            for name in names
        ],
    )
    if result.get("lessons"):
        lines += ["", result["lessons"]["sentence"]]
    for answer in answers:
        lines += ["", f"## {answer.question.words}", "", "```sparql"]
        lines += [with_prefixes(answer.question.sparql).rstrip(), "```", ""]
        lines += _markdown(answer.columns, answer.rows)
    lines += _pictures(folder, result)
    (folder / "report.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "report.html").write_text(report_page(folder, result), encoding="utf-8")


def _pictures(folder: Path, result: Mapping[str, Any]) -> list[str]:
    """Return Markdown with the pictures of each attempt under its object and outcome."""
    lines: list[str] = []
    for encounter in result.get("objects", ()):
        for attempt in encounter["attempts"]:
            made = attempt.get("run", 0)
            pictures = attempt_pictures(folder, encounter["robot"], attempt) if made else []
            if not pictures:
                continue
            familiarity = (
                f"known as {encounter['label'] or 'an object'}"
                if encounter["recognised"]
                else "new"
            )
            came = attempt["place_reason"] if attempt["held"] else attempt["reason"]
            outcome = "held and placed" if attempt["placed"] else f"not {_missing(attempt)}: {came}"
            lines += [
                "",
                f"### {encounter['robot']}: {encounter['product']}, {familiarity}; {outcome}",
                "",
            ]
            lines += _markdown(
                [phase_of(path).replace("_", " ") for path in pictures],
                [[f"![{path.stem}]({path.parent.name}/{path.name})" for path in pictures]],
            )
    return ["", "## Pictures", *lines] if lines else []


def _missing(attempt: Mapping[str, Any]) -> str:
    return "placed" if attempt["held"] else "held"


def show_total(value: object) -> str:
    """Return a total in words: names joined, numbers that are not whole to two places."""
    if value is None or value == []:
        return "-"
    if isinstance(value, list):
        return ", ".join(value)
    return f"{value:.2f}" if isinstance(value, float) else str(value)


def _markdown(columns: Sequence[str], table: Sequence[Sequence[str]]) -> list[str]:
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    return lines + ["| " + " | ".join(row) + " |" for row in table]
