"""The demo in sentences: what its products hide, what is to be seen, and what sharing gained."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from simulate.demo.products import by_product

__all__ = ["Gain", "gains_of", "hidden_in", "opening", "outcome"]

_LIGHT = (
    "These products look like plain boxes, weigh what a Nao can lift, and hide what decides a "
    "grasp: one end of each carton breaks when it is pressed, and each rod is heavy at one end. "
    "Eyes alone cannot tell which, so first attempts often fail."
)
_SECRETS = {
    "plain": "On this table nothing is hidden: geometry holds nearly every product at once, "
    "and sharing has little to add.",
    "light": _LIGHT,
    "fragile": _LIGHT,
    "hard": "These products look like plain boxes and hide what decides a grasp: one end of each "
    "carton breaks when it is pressed, and each bar and flask is heavy at one end. Eyes alone "
    "cannot tell which, so first attempts often fail.",
    "unforeseen": "These products look like plain boxes, and what decides a grasp is none of the "
    "causes that the graph names: both ends break, or all but two ribs, or a lid in the middle; a "
    "band is slippery; or a weight slides from end to end.",
}
_NUMBERS = (
    "No", "One", "Two", "Three", "Four", "Five", "Six", "Seven", "Eight", "Nine", "Ten", "Eleven",
    "Twelve",
)  # fmt: skip


def hidden_in(products: str) -> str:
    """Return what a set of products hides, in a sentence or two; empty for no known set."""
    return _SECRETS.get(products, "")


def opening(products: str, names: Sequence[str], alone: Sequence[str] = ()) -> list[str]:
    """Return two sentences: what the products hide, and what the audience will see.

    Parameters
    ----------
    products
        Set of :data:`simulate.world.objects.PRODUCTS`.
    names
        The robots, in the order in which they work.
    alone
        The robots that work without the graph, for comparison.
    """
    first, *others = names
    seen = f"{first} finds out by trial and writes each outcome into the graph"
    if others:
        then = " and ".join([", ".join(others[:-1]), others[-1]] if others[1:] else others)
        seen += f"; then {then} {'start' if others[1:] else 'starts'} from there"
    if alone:
        same = "robots at the same tables" if alone[1:] else "robot at the same table"
        seen += f", beside the same {same} without the graph ({', '.join(alone)})"
    return [_SECRETS[products], f"Watch: {seen}."]


class Gain:
    """Work of one robot with the graph and without it, over the products that it tried both times.

    Parameters
    ----------
    name
        The robot that shares the graph.
    shared, apart
        Its encounters with and without the graph.
    teachers
        The robots whose outcomes were in the graph before.
    """

    def __init__(
        self,
        name: str,
        shared: Sequence[Mapping[str, Any]],
        apart: Sequence[Mapping[str, Any]],
        teachers: Sequence[str],
    ) -> None:
        alone = {met["product"]: met for met in by_product(apart) if met["tries"]}
        pairs = [
            (met, alone[met["product"]])
            for met in by_product(shared)
            if met["product"] and met["tries"] and met["product"] in alone
        ]
        self.name = name
        self.teachers = tuple(teachers)
        self.products = len(pairs)
        self.attempts = sum(int(met["tries"]) for met, _ in pairs)
        self.attempts_alone = sum(int(met["tries"]) for _, met in pairs)
        self.held = sum(bool(met["held"]) for met, _ in pairs)
        self.held_alone = sum(bool(met["held"]) for _, met in pairs)
        self.placed = sum(bool(met["placed"]) for met, _ in pairs)
        self.placed_alone = sum(bool(met["placed"]) for _, met in pairs)
        self.first_from_graph = sum(
            bool(met["attempts"]) and met["attempts"][0]["source"] == "memory" for met, _ in pairs
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the figures, as ``rtask demo --json`` prints them."""
        return {
            "robot": self.name,
            "products": self.products,
            "attempts": self.attempts,
            "attempts_alone": self.attempts_alone,
            "held": self.held,
            "held_alone": self.held_alone,
            "placed": self.placed,
            "placed_alone": self.placed_alone,
            "first_grasps_from_graph": self.first_from_graph,
            "sentence": self.sentence(),
        }

    def sentence(self) -> str:
        """Return what sharing gained in this run, or that it gained nothing."""
        if not self.products:
            return f"{self.name} and the same robot without the graph tried no product in common."
        if self.placed == self.placed_alone == self.products:
            with_it = f"needed {_attempts(self.attempts)} for {self._all()}"
            without = str(self.attempts_alone)
        else:
            with_it = f"put {self._placed(self.placed, self.attempts)}"
            without = f"put {self._placed(self.placed_alone, self.attempts_alone)}"
        text = f"With the graph {self.name} {with_it}; the same robot without it {without}."
        if (-self.placed, self.attempts) >= (-self.placed_alone, self.attempts_alone):
            text += " In this run the graph gained nothing."
        return f"{text} {self._origin()}"

    def _placed(self, number: int, attempts: int) -> str:
        return f"{number} of {self._all()} into its box in {_attempts(attempts)}"

    def _all(self) -> str:
        return f"{self.products} product{'s' if self.products > 1 else ''}"

    def _origin(self) -> str:
        number = self.first_from_graph
        words = _NUMBERS[number] if number < len(_NUMBERS) else str(number)
        origin = " or ".join(self.teachers) if 0 < len(self.teachers) < 3 else "other robots"
        return f"{words} first grasp{'' if number == 1 else 's'} came from {origin}."


def _attempts(number: int) -> str:
    return f"{number} attempt{'' if number == 1 else 's'}"


def gains_of(
    done: Sequence[Mapping[str, Any]], apart: Mapping[int, Mapping[str, Any]], kept: bool
) -> list[Gain]:
    """Return what sharing gained for each robot that also worked alone.

    Parameters
    ----------
    done
        The robots with their encounters, in the order in which they worked.
    apart
        Work of some of them with a graph of their own, by their place in ``done``.
    kept
        Whether the store had outcomes of an earlier run, whose robots are not named.
    """
    names = [str(robot["name"]) for robot in done]
    return [
        Gain(names[k], done[k]["encounters"], alone["encounters"], [] if kept else names[:k])
        for k, alone in sorted(apart.items())
    ]


def outcome(result: Mapping[str, Any]) -> str:
    """Return the sentences with which a demo ends: one for each robot that also worked alone.

    Parameters
    ----------
    result
        What ``rtask demo --json`` prints.
    """
    if result["gains"]:
        return "\n".join(str(gain["sentence"]) for gain in result["gains"])
    last = result["robots"][-1]
    text = f"{last['name']} held {last['held']} of {last['objects_in_reach']} products in reach"
    if len(result["robots"]) == 1 and not last["known_before"]:
        return f"{text}, on its own; the next robot starts from what it wrote."
    return (
        f"{text}; it recognised {last['recognised']}, and {last['from_memory']} of its first "
        "grasps came from the graph."
    )
