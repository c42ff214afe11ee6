"""Options that several commands share."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

__all__ = ["data_option", "json_option", "print_json"]

data_option = click.option(
    "--data",
    "-d",
    type=click.Path(path_type=Path),
    default=Path("rtask-data"),
    show_default=True,
    envvar="RTASK_DATA",
    show_envvar=True,
    help="Folder of the knowledge base.",
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON.")


def print_json(value: Any) -> None:
    """Print a value as one JSON document."""
    click.echo(json.dumps(value, indent=2, ensure_ascii=False, default=str))
