"""How many of the grasps that earlier robots won reach the last one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from simulate.demo.products import by_product

__all__ = ["Lessons", "closed_where_held", "lessons_of"]

_FROM_GRAPH = "memory"
_IN_SPACE = "scene"
_HALF_A_SUCCESS = 0.5
"""Evidence of success, by the graph, from which a grasp is at the place of a lesson."""
_SAME_PLACE_M = 0.008
"""Half the width of a finger: closer than that, hands touch the same part of a product."""


@dataclass(frozen=True)
class Lessons:
    """Products that an earlier robot held, and how many of them the last robot began from memory.

    Parameters
    ----------
    robot
        The last robot.
    won
        Products that an earlier robot held and the last one tried.
    recalled
        Those of which the last robot's first physical attempt was a grasp from the graph.
    followed
        Those of which it was a grasp of its own to which the graph's successes were credited: at
        the place of a remembered one, but opening wider, or higher, as suits this hand.
    unreachable
        Those not recalled although the graph's answer began with a remembered grasp: the arm found
        no good way to it from where the thing stood this time. More memory would not help there.
    elsewhere
        The others, by name, and whether the last robot's first attempt held all the same.
    same_place, places
        Of the products of which the simulation knows where a hand had held them, and their number:
        those recognised of which the last robot's hand first closed within half a finger's
        width of there, measured along the product: the lesson was used, whoever proposed the grasp.
    won_in_space, recalled_in_space
        Those among them whose first success was planned on the whole view, with a full pose.
    """

    robot: str
    won: int = 0
    recalled: int = 0
    followed: int = 0
    unreachable: int = 0
    same_place: int = 0
    places: int = 0
    won_in_space: int = 0
    recalled_in_space: int = 0
    elsewhere: Mapping[str, bool] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the figures, as ``rtask demo --json`` prints them."""
        return {
            "robot": self.robot,
            "won": self.won,
            "recalled": self.recalled,
            "followed": self.followed,
            "unreachable": self.unreachable,
            "same_place": self.same_place,
            "places": self.places,
            "won_in_space": self.won_in_space,
            "recalled_in_space": self.recalled_in_space,
            "elsewhere": dict(self.elsewhere),
            "sentence": self.sentence(),
        }

    def sentence(self) -> str:
        """Return the figures in words."""
        products = "product" if self.won == 1 else "products"
        text = (
            f"Of {self.won} {products} that another robot had held before, {self.robot} began "
            f"with the remembered grasp at {self.recalled}"
        )
        if self.followed:
            text += f", and with a grasp of its own at the same place at {self.followed}"
        if self.won_in_space:
            text += (
                f" (of {self.won_in_space} held with a grasp planned on the whole view, "
                f"at {self.recalled_in_space})"
            )
        return f"{text}."


def lessons_of(done: Sequence[Mapping[str, Any]]) -> Lessons | None:
    """Return how many lessons of the earlier robots reached the last one; None for a single robot.

    Parameters
    ----------
    done
        The robots with their encounters, in the order in which they worked.
    """
    if len(done) < 2:
        return None
    *teachers, last = done
    won: dict[str, str] = {}
    for teacher in teachers:
        for met in by_product(teacher["encounters"]):
            source = _winning_source(met)
            if met["product"] and source:
                won.setdefault(met["product"], source)
    mine = by_product(last["encounters"])
    first = {met["product"]: _first_attempt(met) for met in mine}
    tried = {product: source for product, source in won.items() if first.get(product)}
    recalled = [product for product in tried if first[product]["source"] == _FROM_GRAPH]
    known = {met["product"] for met in mine if met.get("recognised")}
    followed = {
        product
        for product in (tried.keys() & known) - set(recalled)
        if first[product].get("told", (0.0, 0.0))[0] >= _HALF_A_SUCCESS
    }
    unreachable = [
        product
        for product in tried.keys() - set(recalled)
        if first[product].get("first_offered") == _FROM_GRAPH
    ]
    elsewhere = sorted(tried.keys() - set(recalled) - followed)
    in_space = [product for product, source in tried.items() if source == _IN_SPACE]
    same_place, places = closed_where_held(teachers, last)
    return Lessons(
        str(last["name"]), len(tried), len(recalled), len(followed), len(unreachable),
        same_place, places, len(in_space), sum(product in recalled for product in in_space),
        {product: bool(first[product]["held"]) for product in elsewhere},
    )  # fmt: skip


def closed_where_held(
    teachers: Sequence[Mapping[str, Any]], robot: Mapping[str, Any], knows_by_sight: bool = True
) -> tuple[int, int]:
    """Return at how many products a robot first closed where another had held, and of how many.

    Parameters
    ----------
    knows_by_sight
        Whether only products count that it recognised. A robot without the teachers' graph
        recognises none, and closes there by chance.
    """
    held: dict[str, list[float]] = {}
    for teacher in teachers:
        for met in by_product(teacher["encounters"]):
            for attempt in _won(met):
                if met["product"] and attempt.get("hand"):
                    held.setdefault(met["product"], []).append(attempt["hand"]["along_m"])
    same = of = 0
    for met in by_product(robot["encounters"]):
        first = _first_attempt(met)
        if first and met["product"] in held:
            of += 1
            known = not knows_by_sight or bool(met.get("recognised"))
            hand = first.get("hand")
            if known and hand:
                off = min(abs(hand["along_m"] - place) for place in held[met["product"]])
                same += off <= _SAME_PLACE_M
    return same, of


def _won(met: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the attempts that held and were not lost on the way."""
    return [
        attempt
        for attempt in met["attempts"]
        if attempt["physical"] and attempt["held"] and attempt["place_reason"] != "slip_transport"
    ]


def _winning_source(met: Mapping[str, Any]) -> str:
    """Return the source of the first grasp that held and was not lost on the way; empty if none."""
    return next((str(attempt["source"]) for attempt in _won(met)), "")


def _first_attempt(met: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the first physical attempt; empty without one."""
    return next((attempt for attempt in met["attempts"] if attempt["physical"]), {})
