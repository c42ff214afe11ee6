"""Families that the causes do not know: what memory, causes and both are worth with them.

Each product is tried by a hand without an arm, and fleets of two robots are replayed from the
attempts (:mod:`simulate.fleet.causes_replay`), family by family: the first robot meets products
that nobody knows, one after the other, the second meets the same ones. Families whose secret is one
of the causes stand beside families whose secret is none, and beside a hand that fails by itself.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rtask.errors import UsageError
from simulate.study.attempt_table import Defect, try_product
from simulate.study.declaration import Report, Results, Study, Table
from simulate.world.hidden import HiddenKind
from simulate.world.objects import product
from simulate.world.seeds import stream

__all__ = ["FAMILIES", "Family", "unforeseen_study", "unforeseen_trial"]

_DRAW = 72
_CATALOGUE = 200


@dataclass(frozen=True)
class Family:
    """Products of one fleet.

    Parameters
    ----------
    kinds
        In turn.
    known
        Whether the secret is one of the causes that the graph infers.
    defect
        Of the hand; None for a hand that works.
    """

    kinds: tuple[HiddenKind, ...]
    known: bool = False
    defect: Defect | None = None


FAMILIES: dict[str, Family] = {
    "one end breaks": Family(("carton",), known=True),
    "mass at one end": Family(("bar", "flask"), known=True),
    "both ends break": Family(("brittle",)),
    "slippery band": Family(("banded",)),
    "two ribs hold": Family(("ribbed",)),
    "lid in the middle": Family(("lidded",)),
    "sliding weight": Family(("shifting",)),
    "hand that lets go": Family(("carton", "bar"), defect=Defect(lets_go=0.4)),
    "bent hand": Family(("carton", "bar"), defect=Defect(beside_m=0.012)),
}
"""Families by what they hide."""


def unforeseen_study(count: int, fleets: int, hand: str, seed: int) -> Study:
    """Return the study of families that the causes do not know.

    Parameters
    ----------
    count
        Products of each family.
    fleets
        Replayed with each.

    Raises
    ------
    UsageError
        A number is out of range.
    """
    if not 3 <= count <= _CATALOGUE or fleets < 1:
        raise UsageError(
            f"needs 3 to {_CATALOGUE} products of a family and a fleet, got {count} and {fleets}"
        )
    return Study(
        "families that the causes do not know",
        "simulate.fleet.unforeseen:unforeseen_trial",
        {"seed": seed, "hand": hand, "grasps": 10, "tries": 3, "count": count},
        count * len(FAMILIES),
        functools.partial(_describe, fleets=fleets),
    )


def unforeseen_trial(settings: Mapping[str, Any], number: int) -> dict[str, Any]:
    """Try the grasps of one product of one family; families alternate."""
    name = list(FAMILIES)[number % len(FAMILIES)]
    family, nth = FAMILIES[name], number // len(FAMILIES)
    kind = family.kinds[nth % len(family.kinds)]
    rng = stream(int(settings["seed"]), _DRAW, list(FAMILIES).index(name))
    spec = product(kind, int(rng.permutation(_CATALOGUE)[nth]))
    return {"family": name, **try_product(spec, settings, number, family.defect)}


def _describe(results: Results, settings: Mapping[str, Any], folder: Path, fleets: int) -> Report:
    from simulate.fleet.causes_replay import COLUMNS, CONDITIONS, replay_family, rows_of

    figures: dict[str, Any] = {}
    for name, family in FAMILIES.items():
        products = [result for result in results if result["family"] == name and result["arms"]]
        figures[name] = {
            "known": family.known,
            **replay_family(products, str(settings["hand"]), fleets, int(settings["seed"])),
        }  # fmt: skip
    tables = [
        Table(f"Robot {robot}, attempts to first success", COLUMNS, rows_of(figures, robot))
        for robot in (1, 2)
    ]
    return Report(
        {"families": figures, "conditions": list(CONDITIONS)}, tables, more={"products": results}
    )
