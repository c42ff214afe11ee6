"""Options that several commands of ``rtask simulate`` share, each declared once."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

__all__ = [
    "folder",
    "horizon",
    "json_flag",
    "objects_of_demo",
    "objects_on_table",
    "objects_per_robot",
    "out",
    "preset",
    "prior",
    "products",
    "resume",
    "robot",
    "robots_in_turn",
    "robots_of_demo",
    "seed",
    "trials",
    "workers",
]

Command = Callable[..., Any]
Option = Callable[[Command], Command]

preset = click.option(
    "--preset",
    default="faithful",
    show_default=True,
    type=click.Choice(["faithful", "fast"]),
    help="Physics and camera: as close to the real robot as possible, or fast.",
)
horizon = click.option(
    "--horizon",
    default=0.5,
    show_default=True,
    type=click.FloatRange(0, 60),
    help="How long the arm may go on when its link is lost, s; 0 = to the end of the motion.",
)


def _checked_robot(context: click.Context, parameter: click.Parameter, kinds: Any) -> Any:
    """Refuse kinds of robots that there are not, before anything starts."""
    from simulate.robots import describe

    for kind in [kinds] if isinstance(kinds, str) else kinds:
        describe(kind)
    return kinds


robot = click.option(
    "--robot", default="nao", show_default=True, callback=_checked_robot, help="Kind of robot."
)
robots_in_turn = click.option(
    "--robot",
    "kinds",
    multiple=True,
    default=["nao"],
    show_default=True,
    callback=_checked_robot,
    help="Kinds of the robots, in turn (nao, panda); repeatable.",
)
objects_per_robot = click.option(
    "--objects", default=20, show_default=True, help="Objects per robot."
)
objects_on_table = click.option(
    "--table", "on_table", default=4, show_default=True, help="Objects on the table at once."
)
resume = click.option(
    "--resume", is_flag=True, help="Continue the interrupted run in the output folder."
)


def workers(default: int = 2) -> Option:
    """Return the option for the number of processes."""
    return click.option(
        "--workers", default=default, show_default=True,
        help="Number of processes; does not change the results.",
    )  # fmt: skip


def objects_of_demo() -> Option:
    """Return the option for the number of objects on each table of a demo."""
    return click.option(
        "--objects", type=click.IntRange(min=1),
        help="Objects on each table.  [default: 4 light or fragile ones, else 6]",
    )  # fmt: skip


def robots_of_demo() -> Option:
    """Return the option for the number of robots of a demo."""
    return click.option(
        "--robots", type=click.IntRange(1, 16),
        help="Robots, one after the other.  [default: 3 with light or fragile products, else 2]",
    )  # fmt: skip


def folder() -> click.Path:
    """Return the type of an option that names a folder."""
    return click.Path(path_type=Path, file_okay=False)


def seed(what: str = "products, tables and choices") -> Option:
    """Return the option for the seed, which determines ``what``."""
    return click.option(
        "--seed", default=0, show_default=True, type=click.IntRange(min=0),
        help=f"Determines {what}.",
    )  # fmt: skip


def prior(default: bool) -> Option:
    """Return the flag for grasps that geometry proposes."""
    return click.option(
        "--prior/--no-prior", default=default, help="Whether grasps are proposed from geometry."
    )


def products(default: str) -> Option:
    """Return the option for the set of products on the tables."""
    return click.option(
        "--products",
        type=click.Choice(["plain", "hard", "light", "fragile", "unforeseen"]),
        default=default,
        show_default=True,
        help="Plain products, or ones whose best grasp cannot be seen.",
    )


def trials(default: int, what: str) -> Option:
    """Return the option for the number of trials."""
    return click.option("-n", "--trials", default=default, show_default=True, help=what)


def json_flag(what: str = "figures") -> Option:
    """Return the flag for JSON instead of tables."""
    return click.option("--json", "as_json", is_flag=True, help=f"Print the {what} as JSON.")


def out(default: str) -> Option:
    """Return the option for the output folder of a study."""
    return click.option(
        "--out", default=default, show_default=True, type=folder(), help="Output folder."
    )
