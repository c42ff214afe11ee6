"""The option that says how a view of a table is cut into objects."""

from __future__ import annotations

import click

from rtask.cli.options import option

__all__ = ["segmentation_option"]

_PRESETS = ("auto", "default", "near", "concave", "components", "euclidean")


segmentation_option = option(
    "--segmentation",
    "preset",
    former=["--preset"],
    type=click.Choice(_PRESETS),
    default="auto",
    show_default=True,
    help="How to cut the view; auto decides by the distance of the table.",
)
