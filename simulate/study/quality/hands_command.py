"""The study and the command ``rtask study hands``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from simulate import options
from simulate.study.command import study_command
from simulate.study.declaration import Report, Results, Study

__all__ = ["hands"]


@study_command("rtask-hands", with_preset=False)
@click.option("--hand", "kind", default="cup", show_default=True,
              type=click.Choice(["cup", "three", "jaws"]),
              help="A suction cup, three fingers of 20 N, or the Panda's jaws.")  # fmt: skip
@click.option("--objects", default=60, show_default=True, type=click.IntRange(1),
              help="Generated objects.")  # fmt: skip
@options.seed("objects, views and draws")
@click.option("--radius", default=0.012, show_default=True,
              type=click.FloatRange(0, min_open=True), help="Radius of the cup, m.")  # fmt: skip
@click.option("--opening", default=0.1, show_default=True,
              type=click.FloatRange(0, min_open=True), help="Of the three fingers, m.")  # fmt: skip
def hands(kind: str, objects: int, seed: int, radius: float, opening: float) -> Study:
    """Compare grasps of a hand planned on one noisy view with those on the whole mesh.

    A hand without an arm carries out the first grasp of either plan four times, under the same
    errors of the pose and frictions, lifts and shakes. The interval resamples objects.
    """
    settings = {"seed": seed, "hand": kind, "radius": radius, "opening": opening}
    trial = "simulate.study.quality.hands:hand_trial"
    return Study("hands", trial, settings, objects, _describe)


def _describe(results: Results, settings: Any, folder: Path) -> Report:
    import numpy as np

    from simulate.study.quality.hands import summarise_hands

    shares = np.array([result["shares"] for result in results], dtype=float)
    summary = summarise_hands(shares)
    figures = {"hand": settings["hand"], "seed": settings["seed"], **summary}
    lines = []
    for name in ("lifted", "carried"):
        row = summary[name]
        low, high = row["interval95"]
        lines.append(
            f"{name}: mesh {row['mesh']:.3f}, one view {row['view']:.3f}, difference "
            f"{row['difference']:+.3f} [{low:+.3f}, {high:+.3f}]"
        )
    without = summary["without_a_grasp"]
    lines.append(
        f"without a grasp: mesh {without['mesh']}, one view {without['view']} of "
        f"{summary['objects']}"
    )
    return Report(figures, lines=lines, more={"trials": list(results)})
