"""The report of a demo as one page, for people: each robot with the graph beside itself without."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from simulate.demo.products import by_product
from simulate.demo.report_attempts import robot_cell
from simulate.demo.report_hand import HATCH
from simulate.demo.story import hidden_in

__all__ = ["report_page"]

_HERE = Path(__file__).parent
Met = dict[str, dict[str, Any]]


def report_page(folder: Path, result: Mapping[str, Any]) -> str:
    """Return the page; pictures are named relative to the folder.

    Parameters
    ----------
    folder
        Folder of the report, with one folder of pictures for each robot.
    result
        What ``rtask demo --json`` prints.
    """
    work = _by_robot([*result.get("objects", ()), *result.get("alone_objects", ())])
    groups = _groups(result)
    products = list(dict.fromkeys(p for robot in work.values() for p in robot))
    parts = (
        [f"<p>{escape(secret)}</p>"] if (secret := hidden_in(str(result.get("products")))) else []
    )
    parts += [f'<p class="gain">{escape(sentence)}</p>' for sentence in _sentences(result)]
    parts += [_chart(group, work, products) for group in groups if len(group) == 2]
    parts.append(_totals([*result["robots"], *_alone(result)]))
    parts.append(_legend(work))
    for product in products:
        rows = [_row(folder, product, group, work) for group in groups]
        parts.append(f"<h2>{escape(product or 'not on any list')}</h2>\n" + "\n".join(rows))
    style, script = ((_HERE / f"report.{kind}").read_text("utf-8") for kind in ("css", "js"))
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>What the robots did</title><style>\n{style}</style></head><body>\n{HATCH}<main>"
        "<h1>What the robots did</h1>\n" + "\n".join(parts) + f"\n{_notes()}</main>\n"
        f"<script>\n{script}</script></body></html>\n"
    )


def _alone(result: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the totals of the robots that worked without the graph."""
    last = result.get("alone")
    return list(result.get("alone_robots") or ([last] if last else []))


def _groups(result: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return the robots that stand in a row: one, or one with the graph and the same without."""
    names = [str(robot["name"]) for robot in result["robots"]]
    alone = {str(robot["name"]) for robot in _alone(result)}
    return [(name, f"{name}-alone") if f"{name}-alone" in alone else (name,) for name in names]


def _by_robot(encounters: Sequence[Mapping[str, Any]]) -> dict[str, Met]:
    """Return what each robot did with each product."""
    names = dict.fromkeys(str(met["robot"]) for met in encounters)
    return {
        name: {
            str(met["product"]): met
            for met in by_product([met for met in encounters if met["robot"] == name])
        }
        for name in names
    }


def _sentences(result: Mapping[str, Any]) -> list[str]:
    gains = result.get("gains") or ([result["gain"]] if result.get("gain") else [])
    lessons = [result["lessons"]["sentence"]] if result.get("lessons") else []
    return [*(gain["sentence"] for gain in gains), *lessons]


def _notes() -> str:
    """Return how to read the page."""
    return (
        '<p class="notes">Every robot faced the same products, one robot after the other, each '
        "elsewhere and in another light. Held and placed are the robots' own judgements.</p>"
    )


def _legend(work: Mapping[str, Met]) -> str:
    """Return how to read the drawings; empty where there is none."""
    if not any(met.get("hidden") for robot in work.values() for met in robot.values()):
        return ""
    return (
        '<p class="notes">The drawings show each product from above, to scale, with the hand of '
        "the attempt and, as lines, where the hand closed in the others. Hatched: the part that "
        "breaks when it is pressed. Dot: the centre of mass. Both come from the simulation; no "
        "robot sees them. The bar below is the chance that the robot gave the grasp.</p>"
    )


def _chart(group: Sequence[str], work: Mapping[str, Met], products: Sequence[str]) -> str:
    """Return bars: attempts at each product with the graph and without."""
    pairs = [
        (product, [work.get(name, {}).get(product) for name in group])
        for product in products
        if product
    ]
    tried = [(product, [m for m in met if m and m["tries"]]) for product, met in pairs]
    tried = [(product, met) for product, met in tried if len(met) == len(group)]
    if not tried:
        return ""
    most = max(int(met["tries"]) for _, both in tried for met in both)
    rows = [
        f"<tr><th>{escape(product)}</th><td>{_bar(both[0], most, 'with')}"
        f"{_bar(both[1], most, 'without')}</td></tr>"
        for product, both in tried
    ]
    return (
        f'<table class="chart"><caption>Attempts of {escape(group[0])} at each product, '
        f'<b class="with">with the graph</b> and <b class="without">without</b></caption>'
        f"<tbody>{''.join(rows)}</tbody></table>"
    )


def _bar(met: Mapping[str, Any], most: int, kind: str) -> str:
    made = int(met["tries"])
    words = str(made) if met["held"] else f"{made}, none held"
    return (
        f'<div class="count {kind}"><i style="width:{100 * made / most:.0f}%"></i>'
        f"<span>{words}</span></div>"
    )


def _totals(robots: Sequence[Mapping[str, Any]]) -> str:
    """Return a table of the robots."""
    rows = "".join(
        f"<tr><th>{escape(str(robot['name']))}</th><td>{robot['held']} of "
        f"{robot['objects_in_reach']}</td><td>{robot['placed']}</td><td>{_mean(robot)}</td>"
        f"<td>{robot['from_memory']}</td></tr>"
        for robot in robots
    )
    return (
        '<table class="totals"><caption>The robots</caption><thead><tr><th>robot</th>'
        "<th>held, of those in reach</th><th>placed</th><th>attempts until the first success</th>"
        f"<th>first grasps from its graph</th></tr></thead><tbody>{rows}</tbody></table>"
    )


def _mean(robot: Mapping[str, Any]) -> str:
    mean = robot["mean_attempts_to_first_success"]
    return "none held" if mean is None else f"{mean:.2f}"


def _row(folder: Path, product: str, group: Sequence[str], work: Mapping[str, Met]) -> str:
    """Return what the robots of a group did with one product, with a slider through the attempts.

    The page's script shows the slider where there are two attempts or more.
    """
    shared = (True, False) if len(group) == 2 else (None,)
    cells = [
        robot_cell(folder, name, is_shared, work.get(name, {}).get(product))
        for name, is_shared in zip(group, shared, strict=True)
    ]
    slider = (
        f'<label class="slide" hidden>attempt <output>1</output> of {most} <input type="range" '
        f'min="1" max="{most}" value="1"></label>'
        if (most := max(count for _, count in cells)) > 1
        else ""
    )
    shown = "".join(cell for cell, _ in cells)
    return f'<section class="row">{slider}<div class="cells">{shown}</div></section>'
