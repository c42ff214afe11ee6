"""Assignment of products to the robots of a fleet: common products and robots' own."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from rtask.errors import UsageError
from simulate.world.objects import sample_products
from simulate.world.seeds import stream

__all__ = ["FleetPlan", "MemberJob", "plan_fleet"]

_PRODUCTS, _ORDER = 30, 31
MAX_ROBOTS, MAX_ON_TABLE = 16, 8


@dataclass(frozen=True)
class MemberJob:
    """Task of one robot of a fleet, convertible to JSON.

    Parameters
    ----------
    name, index
        Its name, which is its token's agent, and its number.
    url
        Of the endpoint.
    tables
        Names of the products on each table, in order.
    prior
        Whether it may ask for grasps proposed from geometry; otherwise it grasps unknown objects
        blindly.
    outbox
        File for reports that could not be delivered yet.
    patience_s
        Time that it waits for an answer before it gives up.
    robot
        Kind of robot, from :func:`simulate.robots.known_robots`.
    look_alikes
        Whether the products look as they are named and hide the opposite.
    """

    name: str
    index: int
    url: str
    seed: int
    tables: list[list[str]]
    max_attempts: int
    prior: bool
    outbox: str
    patience_s: float = 900.0
    preset: str = "faithful"
    robot: str = "nao"
    look_alikes: bool = False

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON data."""
        return asdict(self)


@dataclass(frozen=True)
class FleetPlan:
    """The products of a fleet.

    Parameters
    ----------
    common
        Names of the products that every robot encounters, table by table.
    own
        For each robot the products that no other robot encounters, table by table.
    """

    common: tuple[tuple[str, ...], ...]
    own: tuple[tuple[tuple[str, ...], ...], ...]

    def tables(self, robot: int) -> list[list[str]]:
        """Return the products on each table of one robot."""
        return [[*a, *b] for a, b in zip(self.common, self.own[robot], strict=True)]

    def is_common(self, name: str) -> bool:
        """Return whether every robot encounters a product."""
        return any(name in table for table in self.common)


def plan_fleet(
    robots: int, objects: int, on_table: int, seed: int, products: str = "plain"
) -> FleetPlan:
    """Draw the products of a fleet: half of a robot's products are common to all robots.

    Parameters
    ----------
    robots
        Number of robots.
    objects
        Objects per robot; a multiple of ``on_table``.
    on_table
        Objects on a table at once; an even number.
    products
        Set of :data:`simulate.world.objects.PRODUCTS`.

    Raises
    ------
    UsageError
        Naming what does not fit.

    Examples
    --------
    >>> plan = plan_fleet(3, 8, 4, seed=1)
    >>> [len(table) for table in plan.tables(2)]
    [4, 4]
    >>> set(plan.tables(0)[0]) & set(plan.tables(1)[0]) == set(plan.common[0])
    True
    """
    if not 1 <= robots <= MAX_ROBOTS:
        raise UsageError(f"--robots must lie in 1..{MAX_ROBOTS}, got {robots}")
    if not 2 <= on_table <= MAX_ON_TABLE or on_table % 2:
        raise UsageError(f"--table must be even and lie in 2..{MAX_ON_TABLE}, got {on_table}")
    if objects < on_table or objects % on_table:
        raise UsageError(f"--objects must be a multiple of --table {on_table}, got {objects}")
    if seed < 0:
        raise UsageError(f"--seed must not be negative, got {seed}")
    half, tables = on_table // 2, objects // on_table
    names = [
        spec.name
        for spec in sample_products(products, stream(seed, _PRODUCTS), half * tables * (robots + 1))
    ]
    rows = [tuple(names[i : i + half]) for i in range(0, len(names), half)]
    groups = [tuple(rows[i : i + tables]) for i in range(0, len(rows), tables)]
    return FleetPlan(groups[0], tuple(groups[1:]))
