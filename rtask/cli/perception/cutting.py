"""The option that says how a view of a table is cut into objects."""

from __future__ import annotations

import click

__all__ = ["segmentation_option"]

_PRESETS = ("auto", "default", "near", "concave", "components", "euclidean")


segmentation_option = click.option(
    "--segmentation",
    "preset",
    type=click.Choice(_PRESETS),
    default="auto",
    show_default=True,
    help="How to cut the view; auto decides by the distance of the table.",
)
