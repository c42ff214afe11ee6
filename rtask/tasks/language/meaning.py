"""What a goal in words means: phrases about things, places, deeds, and conditions on the world.

All are frozen, so that two ways of reading a sentence that come to the same are equal.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from rtask.asking.questions.mentions import Mention

__all__ = [
    "LIMITS", "Comparison", "Condition", "Deed", "Name", "Phrase", "Place", "Quantity",
    "Superlative",
]  # fmt: skip

LIMITS = frozenset(("untouched", "else", "alone", "barred"))
"""Kinds of deeds that are none, but limits of all others."""


@dataclass(frozen=True)
class Name:
    """A stretch of a goal that names something, with all that it can stand for."""

    mentions: tuple[Mention, ...]

    @property
    def text(self) -> str:
        """The words."""
        return self.mentions[0].text

    @property
    def is_plural(self) -> bool:
        """Whether the words are the plural of the name."""
        return all(item.is_plural for item in self.mentions)

    def role(self, *roles: str) -> Mention | None:
        """Return what it names in the first of some roles that it has; None for none."""
        for role in roles:
            mention = next((item for item in self.mentions if item.role == role), None)
            if mention is not None:
                return mention
        return None


@dataclass(frozen=True)
class Quantity:
    """How many things are meant.

    Parameters
    ----------
    kind
        all, some (at least so many), exactly, at_most, share (of all), all_but (so many are left
        out), no, or definite (all, of which there are so many).
    number
        So many; of a share, a fraction.
    total
        Of how many, where that is said: "one of the two cups".
    """

    kind: str
    number: float = 0
    total: int = 0

    @property
    def text(self) -> str:
        """The words for it."""
        if self.kind in ("all", "definite"):
            return "all:"
        if self.kind == "some":
            return "one of:" if self.number == 1 else f"{self.number:g} of:"
        if self.kind == "all_but":
            return f"all but {self.number:g} of:"
        if self.kind == "share":
            return f"{self.number * 100:.0f} % of:"
        return f"{self.kind.replace('_', ' ')} {self.number:g} of:"


@dataclass(frozen=True)
class Comparison:
    """That a measure of things is above or below a value, in SI units.

    Parameters
    ----------
    than
        The one thing whose measure is the value, until that has been looked up.
    """

    measure: str
    is_above: bool
    value: float
    than: Phrase | None = None


@dataclass(frozen=True)
class Superlative:
    """That things have the most, or the least, of a measure.

    Parameters
    ----------
    measure
        One of :data:`~rtask.tasks.language.lexicon.MEASURES`, or "distance", or "seen": when they
        were seen last.
    to
        From what a distance counts; None where that is still to be said.
    """

    measure: str
    is_most: bool
    to: Place | None = None

    @property
    def text(self) -> str:
        """The words for it."""
        if self.measure == "seen":
            return "last seen" if self.is_most else "longest not seen"
        if self.measure == "distance":
            to = self.to.text if self.to is not None else "?"
            return f"farthest from {to}" if self.is_most else f"nearest to {to}"
        return f"{'most' if self.is_most else 'least'} {self.measure}"


@dataclass(frozen=True)
class Place:
    """A place of which any of some names will do.

    Parameters
    ----------
    names
        Names of places, robots or things that carry others.
    owner
        The robot that reaches it.
    holds
        The place is where this is now.
    anaphor
        A word that stands for a place named before, such as "there".
    """

    names: tuple[Name, ...] = ()
    owner: Name | None = None
    holds: Phrase | None = None
    anaphor: str = ""

    @property
    def text(self) -> str:
        """What it says, for people."""
        if self.holds is not None:
            return f"where {self.holds.text} is"
        of = f" of {self.owner.text}" if self.owner is not None else ""
        return " or ".join(name.text for name in self.names) + of if self.names else self.anaphor


@dataclass(frozen=True)
class Phrase:
    """What things are: names of which all fit, and what else is said about them.

    Parameters
    ----------
    heads
        Names; empty for "things", "ones" and what stands for a noun.
    is_definite
        With an article: of "the cup" there is one.
    colours, materials
        Each with whether they do not have it; of several names in one, any will do.
    traits
        Such as heavy or fragile.
    places
        Where they are now, or, negated, where they are not.
    left_out
        What is not meant.
    owners
        Whose they are: names of which any will do, for each.
    reached_by
        Robots that reach the place where they are, each with whether they do not.
    others
        What no part of the goal before is about: the rest.
    is_only
        Nothing else is to be treated so.
    anaphor
        "it", "them": what was named before.
    """

    heads: tuple[Name, ...] = ()
    is_generic: bool = False
    is_plural: bool = False
    is_definite: bool = False
    quantity: Quantity | None = None
    colours: tuple[tuple[tuple[Name, ...], bool], ...] = ()
    materials: tuple[tuple[tuple[Name, ...], bool], ...] = ()
    traits: tuple[tuple[tuple[Name, ...], bool], ...] = ()
    kinds_not: tuple[Name, ...] = ()
    places: tuple[tuple[Place, bool], ...] = ()
    comparisons: tuple[Comparison, ...] = ()
    superlative: Superlative | None = None
    left_out: tuple[Phrase, ...] = ()
    owners: tuple[Name, ...] = ()
    reached_by: tuple[tuple[Name, bool], ...] = ()
    others: bool = False
    is_only: bool = False
    is_elided: bool = False
    anaphor: str = ""

    @property
    def is_described(self) -> bool:
        """Whether it says what its things are like."""
        return bool(
            self.colours or self.materials or self.traits or self.kinds_not or self.comparisons
            or self.superlative or self.owners or self.reached_by
        )  # fmt: skip

    @property
    def text(self) -> str:
        """What it says, for people."""
        if self.anaphor:
            return self.anaphor
        words = ["only"] * self.is_only + ["other"] * self.others
        words += [name.text for name in self.owners]
        most = self.superlative
        if most is not None and most.to is None:
            words.append(most.text)
        for group in (self.traits, self.colours, self.materials):
            for names, is_not in group:
                words.append("not " * is_not + " or ".join(name.text for name in names))
        words += [name.text for name in self.heads] or ["things"]
        words += [f"not {name.text}" for name in self.kinds_not]
        words += [most.text] if most is not None and most.to is not None else []
        words += [
            f"{item.measure} {'above' if item.is_above else 'below'} "
            + (item.than.text if item.than is not None else f"{item.value:g}")
            for item in self.comparisons
        ]
        words += [
            f"{'not ' * is_not}within reach of {name.text}" for name, is_not in self.reached_by
        ]
        words += [f"{'not ' * is_not}from {place.text}" for place, is_not in self.places]
        words += [f"except {phrase.text}" for phrase in self.left_out]
        return " ".join(words)


@dataclass(frozen=True)
class Deed:
    """One thing to be done with the things of one phrase.

    Parameters
    ----------
    kind
        put, hold, away (anywhere but where they are), back, stay (where they are in the end), swap,
        no (none may be there); or what limits all that is done: untouched, else (nothing else is
        touched), alone and barred (the only robots, and those that do nothing).
    source
        For away and no: where they may not be any more.
    partner
        What a swap is with.
    stage
        Deeds of a later stage are begun once those before are reached.
    robots
        Of a limit: whom it is about.
    """

    kind: str
    phrase: Phrase
    target: Place | None = None
    source: Place | None = None
    partner: Phrase | None = None
    stage: int = 0
    robots: tuple[Name, ...] = ()

    @property
    def is_limit(self) -> bool:
        """Whether it says what may not be done, or who may do it."""
        return self.kind in LIMITS


@dataclass(frozen=True)
class Condition:
    """A state of the world on which a goal hangs.

    Parameters
    ----------
    phrase
        Things; that such are there, or that they are as ``place`` and ``quality`` say.
    place
        Where.
    quality
        What they are to be, as a phrase.
    is_not
        The goal is to be reached if it does not hold.
    """

    phrase: Phrase | None
    place: Place | None = None
    quality: Phrase | None = None
    is_not: bool = False
    is_empty: bool = field(default=False)
    """The place is to be empty."""
