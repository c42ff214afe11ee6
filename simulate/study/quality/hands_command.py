"""The command ``rtask study hands``."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, TextIO

import click

from simulate import options

__all__ = ["hands"]


@click.command()
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
@options.json_flag("figures")
def hands(kind: str, objects: int, seed: int, radius: float, opening: float, as_json: bool) -> None:
    """Compare grasps of a hand planned on one noisy view with those on the whole mesh.

    A hand without an arm carries out the first grasp of either plan four times, under the same
    errors of the pose and frictions, lifts and shakes. The interval resamples objects.
    """
    import os

    with os.fdopen(os.dup(1), "w", encoding="utf-8") as out:
        os.dup2(2, 1)  # Bullet and Mesa write there
        import numpy as np

        from simulate.study.quality.hands import (
            StudiedHand,
            cup,
            held_shares,
            jaws,
            summarise_hands,
            three_fingers,
        )
        from simulate.study.runner import Progress

        kinds: dict[str, Callable[[], StudiedHand]] = {
            "cup": partial(cup, radius), "three": partial(three_fingers, opening), "jaws": jaws,
        }  # fmt: skip
        hand = kinds[kind]()
        progress = Progress(objects, 0)
        shares = []
        for number in range(objects):
            shares.append(held_shares(hand, seed, number))
            progress.step()
        summary = summarise_hands(np.array(shares))
        if as_json:
            click.echo(json.dumps({"hand": kind, "seed": seed, **summary}), out)
        else:
            _print_summary(summary, out)


def _print_summary(summary: Mapping[str, Any], out: TextIO) -> None:
    for name in ("lifted", "carried"):
        row = summary[name]
        low, high = row["interval95"]
        click.echo(
            f"{name}: mesh {row['mesh']:.3f}, one view {row['view']:.3f}, difference "
            f"{row['difference']:+.3f} [{low:+.3f}, {high:+.3f}]",
            out,
        )
    without = summary["without_a_grasp"]
    click.echo(
        f"without a grasp: mesh {without['mesh']}, one view {without['view']} of "
        f"{summary['objects']}",
        out,
    )
