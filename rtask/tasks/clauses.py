"""Clauses of goals: how many of what, from where, to where, and what is left out.

Each word and each name has to fit where it stands. A clause read as a bag of words is understood
wrongly sooner or later, and then carried out: "put the left box on the table" moved what was in the
box, and "everything except the cups and the bottles" moved the bottles.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

from rtask.asking.questions.mentions import Mention
from rtask.asking.questions.words import stem
from rtask.errors import UsageError
from rtask.tasks.phrasing import EXCEPT

__all__ = ["Clause", "Name", "NounPhrase", "is_familiar", "is_verb", "listed", "read_clause"]

_GRASP = frozenset(["hold", "grasp", "grip", "pick", "lift"])
_TAKE, _REMOVE = frozenset(["take"]), frozenset(["remove"])
_CLEAR = frozenset(["empty", "clear"])
_CARRY = frozenset(
    ("move", "put", "bring", "place", "get", "carry", "store", "sort", "drop", "lay", "set",
     "hand", "pass", "fetch", "give", "grab")
)  # fmt: skip
_VERBS = _GRASP | _TAKE | _REMOVE | _CLEAR | _CARRY
_COPULAS = frozenset(("be", "go", "belong", "should", "must", "shall", "may"))
_LIE = frozenset(("lie", "stand", "sit"))
_INTO = frozenset(("into", "onto", "to", "inside"))
_AT = frozenset(("in", "on", "at"))
_FROM = frozenset(("from", "of", "off"))
_ARTICLES = frozenset(("the", "my", "our"))
_BEFORE_PLACE = _ARTICLES | {"a", "an", "any"}
_ALL = frozenset(("all", "every", "each", "both"))
_ANY = frozenset(("a", "an", "any", "some"))
_NUMBERS = {
    "two": 2, "three": 3, "four": 4, "five": 5, "six": 6, "seven": 7, "eight": 8, "nine": 9,
    "ten": 10,
}  # fmt: skip
_NOUNS = frozenset(("thing", "object", "item"))
_PRONOUNS = {"everything": (None, "all:"), "something": (1, "one of:"), "anything": (1, "one of:")}
_STAY = frozenset(("left", "stay", "remain", "there"))
_WORDS = (
    _VERBS | _COPULAS | _LIE | _INTO | _AT | _FROM | _BEFORE_PLACE | _ALL | _ANY | _NOUNS | _STAY
    | {"first", "up", "down", "that", "which", "who", "not", "no", "nothing", "one",
       "ones", "and", "back", EXCEPT, "it", "them", *_NUMBERS, *_PRONOUNS}
)  # fmt: skip


@dataclass(frozen=True)
class Name:
    """A stretch of a goal that names something, with all that it can stand for."""

    mentions: tuple[Mention, ...]

    @property
    def text(self) -> str:
        """The words."""
        return self.mentions[0].text

    def role(self, *roles: str) -> Mention | None:
        """Return what it names in the first of some roles that it has; None for none."""
        for role in roles:
            mention = next((item for item in self.mentions if item.role == role), None)
            if mention is not None:
                return mention
        return None


@dataclass
class NounPhrase:
    """What things are: names of which all fit, colours, and places where they are now."""

    heads: list[Name] = field(default_factory=list)
    colours: list[Name] = field(default_factory=list)
    other_colours: list[Name] = field(default_factory=list)
    """Colours that they do not have."""
    sources: list[Name] = field(default_factory=list)
    is_generic: bool = False
    """Whether it says "things" or "ones" instead of a name."""
    is_plural: bool = False

    @property
    def is_empty(self) -> bool:
        """Whether it says nothing of things but where they are."""
        return not (self.heads or self.colours or self.other_colours or self.is_generic)

    @property
    def has_bare_colour(self) -> bool:
        """Whether it names a colour, and nothing that has it."""
        return bool(self.colours or self.other_colours) and not (self.heads or self.is_generic)

    @property
    def text(self) -> str:
        """What it says, for people."""
        words = [name.text for name in self.colours]
        words += [f"not {name.text}" for name in self.other_colours]
        words += [name.text for name in self.heads] or ["things"] * bool(words)
        return " ".join([*words, *(f"from {name.text}" for name in self.sources)])


@dataclass
class Clause:
    """A part of a goal as it was understood.

    Parameters
    ----------
    text
        Its words.
    verb
        grasp, take, remove, empty, clear or carry; empty without one.
    subject
        What it is about.
    quantity
        For how many things, None for all, and the words for that; None where it does not say.
    target, owner
        Where to, and the robot that reaches that place.
    left_out
        What it is not about.
    removes
        Whether things are to be anywhere but where they are.
    """

    text: str
    verb: str = ""
    subject: NounPhrase = field(default_factory=NounPhrase)
    quantity: tuple[int | None, str] | None = None
    target: Name | None = None
    owner: Name | None = None
    left_out: list[NounPhrase] = field(default_factory=list)
    removes: bool = False
    goes_back: bool = False
    """Whether things are to be where they were before they came to where they are."""
    is_continued: bool = False
    """Whether it goes on with the verb of the clause before it."""


@dataclass(frozen=True)
class _At:
    """A place in a clause, the preposition before it, and what stood before that."""

    preposition: str
    name: Name
    is_relative: bool
    is_early: bool
    owner: Name | None = None


def is_familiar(word: str) -> bool:
    """Return whether goals can have a word that is no name."""
    return word in _WORDS or stem(word) in _WORDS or word.isdigit()


def is_verb(word: str) -> bool:
    """Return whether a word says what to do, as one that begins a clause does."""
    return word in _VERBS or (stem(word) in _VERBS and word not in _PRONOUNS)


def listed(mentions: Sequence[Mention]) -> str:
    """Return names and what each stands for, for messages."""
    named = [f"{item.text!r} ({item.role})" for item in mentions]
    return ", ".join(dict.fromkeys(named)) or "nothing"


def read_clause(tokens: Sequence[str], mentions: Sequence[Mention]) -> Clause:
    """Return a clause of which every word is understood where it stands.

    Raises
    ------
    UsageError
        A word or name does not fit where it stands; the message says which.
    """
    reader = _Reader(tokens, mentions)
    for at, item in _items(tokens, mentions):
        if isinstance(item, Name):
            reader.take_name(item)
        else:
            reader.take_word(at, item)
    return reader.finish()


def _items(tokens: Sequence[str], mentions: Sequence[Mention]) -> Iterator[tuple[int, str | Name]]:
    """Yield words, and in place of the words of a name that name."""
    spans: dict[int, list[Mention]] = {}
    for mention in mentions:
        spans.setdefault(mention.start, []).append(mention)
    at = 0
    while at < len(tokens):
        if at in spans:
            yield at, Name(tuple(spans[at]))
            at = spans[at][0].end
        else:
            yield at, tokens[at].lower()
            at += 1


class _Reader:
    """Reads a clause from left to right."""

    def __init__(self, tokens: Sequence[str], mentions: Sequence[Mention]) -> None:
        self._tokens, self._mentions = tokens, mentions
        self.clause = Clause(" ".join(tokens))
        self._phrase = self.clause.subject
        self._places: list[_At] = []
        self._preposition = self._last = ""
        self._is_relative = self._is_negated = self._is_nothing = False

    def take_word(self, at: int, word: str) -> None:
        """Read a word that is no name."""
        taken = self._take_function_word(at, word) or self._take_verb(word)
        if not taken and not self._take_quantity(word):
            self._refuse(word)
        self._last = word

    def _take_function_word(self, at: int, word: str) -> bool:
        phrase, is_out = self._phrase, self._is_out
        if (word == "first" and at == 0) or word in _ARTICLES:
            return True
        if word in ("up", "down"):
            return bool(self.clause.verb)
        if word == EXCEPT or (word == "and" and is_out):
            if self._preposition or (is_out and phrase.is_empty):
                return False
            self._phrase = NounPhrase()
            self.clause.left_out.append(self._phrase)
            return True
        if word in _INTO | _AT | _FROM:
            if self._preposition and (self._preposition, word) != ("off", "of"):
                return False
            self._preposition = self._preposition or word
            return True
        if word in ("that", "which", "who") or stem(word) in _LIE:
            # Only after what they describe: "the standing cups" is none of what is understood.
            self._is_relative = not phrase.is_empty
            return self._is_relative
        if word == "back":
            self.clause.goes_back = bool(self.clause.verb) and not self._preposition
            return self.clause.goes_back
        if word == "not":
            self._is_negated = True
            return not phrase.is_empty or is_out
        return self._take_stay(at, word)

    def _take_stay(self, at: int, word: str) -> bool:
        """Read "no cup may stay on the table", and "there should be nothing on it"."""
        if word in ("no", "nothing"):
            # "put nothing in the box" forbids a deed, and asks for none.
            if self.clause.verb:
                return False
            self._is_nothing = True
            self._phrase.is_generic |= word == "nothing"
            return self.clause.quantity is None and self._phrase is self.clause.subject
        return word in _STAY and (self._is_nothing or (word == "there" and at == 0))

    def _take_verb(self, word: str) -> bool:
        root = word if word in _VERBS | _COPULAS else stem(word)
        if root in _COPULAS:
            if not self._last:  # "is the cup in the box" is a question
                return False
            if self._preposition == "to":
                self._preposition = ""
            return not self._preposition
        is_first = not self.clause.verb and self.clause.subject.is_empty and not self._preposition
        if root not in _VERBS or not (is_first or stem(self._last) == "be"):
            return False
        groups = {"grasp": _GRASP, "carry": _CARRY}
        self.clause.verb = next((name for name, of in groups.items() if root in of), root)
        return True

    def _take_quantity(self, word: str) -> bool:
        phrase, clause = self._phrase, self.clause
        if self._preposition:
            return word in _BEFORE_PLACE or self._take_part(word)
        if word in ("one", "ones") and self._stands_for_noun():
            phrase.is_generic, phrase.is_plural = True, word == "ones"
            return True
        if stem(word) in _NOUNS and not phrase.heads and not phrase.is_generic:
            phrase.is_generic, phrase.is_plural = True, word != stem(word)
            return True
        if self._is_out:  # "all but two cups": which two are left out, nobody has said
            return word in _ALL
        if not phrase.is_empty:
            return False
        if word in _PRONOUNS:
            phrase.is_generic = True
            return self._set_quantity(*_PRONOUNS[word])
        if word in _ALL:
            return self._set_quantity(None, "all:")
        number = int(word) if word.isdigit() else _NUMBERS.get(word, 1)
        if number > 1 and clause.quantity == (1, "one of:") and self._last == "any":
            clause.quantity = None
        is_number = word.isdigit() or word in _NUMBERS
        if is_number:
            return number > 0 and self._set_quantity(number, f"{number} of:")
        return (word in _ANY or word == "one") and self._set_quantity(1, "one of:")

    def _take_part(self, word: str) -> bool:
        """Read how many there are of those of which some are meant: "one of the two cups"."""
        is_number = word.isdigit() or word in _NUMBERS
        return self._preposition == "of" and self.clause.quantity is not None and is_number

    def _stands_for_noun(self) -> bool:
        phrase = self._phrase
        described = bool(phrase.colours or phrase.other_colours)
        is_after_article = self._last == "the" and self._is_out
        return not phrase.heads and (described or is_after_article)

    def _set_quantity(self, number: int | None, words: str) -> bool:
        if self.clause.quantity is not None or self._is_nothing:
            return False
        self.clause.quantity = number, words
        return True

    @property
    def _is_out(self) -> bool:
        return bool(self.clause.left_out)

    def take_name(self, name: Name) -> None:
        """Read a name."""
        if self._preposition:
            self._take_after_preposition(name)
        elif name.role("place"):
            self._take_bare_place(name)
        elif name.role("colour"):
            self._take_colour(name)
        else:
            self._take_head(name)
        self._preposition, self._last = "", name.text

    def _take_after_preposition(self, name: Name) -> None:
        preposition = self._preposition
        if name.role("place"):
            self._take_place(name)
        elif name.role("robot") and preposition == "of" and self._places:
            self._places[-1] = replace(self._places[-1], owner=name)
        elif name.role("robot") and preposition == "of" and self.clause.target is not None:
            self.clause.owner = name
        elif preposition in _INTO | _AT and name.role("robot", "thing", "object"):
            self._places.append(_At("to", name, self._is_relative, self._is_early()))
        elif preposition == "of" and name.role("colour") and self._phrase.is_empty:
            self._take_colour(name)
        elif (preposition == "of" or (preposition == "to" and name.role("use"))) and not (
            self._phrase.heads
        ):
            self._take_head(name)
        else:
            raise UsageError(
                f"{preposition} {name.text!r} in {self.clause.text!r} is not understood: it is no "
                f"place; {self._understood()}"
            )

    def _take_place(self, name: Name) -> None:
        if self._is_out and self._preposition not in _INTO:
            there = any(not at.is_relative and at.preposition in _AT for at in self._places)
            is_described = self._is_relative or self._preposition in _FROM or (
                there and self._phrase.is_generic
            )  # fmt: skip
            # "everything on the table except the cups in the box": are the cups there, or to be?
            if self._phrase.is_empty or (there and not is_described):
                self._refuse(name.text)
        else:
            is_described = False
        if is_described:
            self._phrase.sources.append(name)
        else:
            self._places.append(_At(self._preposition, name, self._is_relative, self._is_early()))
        self._is_relative = False

    def _is_early(self) -> bool:
        return self.clause.subject.is_empty and self.clause.quantity is None

    def _take_bare_place(self, name: Name) -> None:
        if name.role("object", "thing"):
            self._take_head(name)
        elif self.clause.verb in _CLEAR and self.clause.target is None and self._is_early():
            self.clause.target = name
        else:
            raise UsageError(
                f"{name.text!r} in {self.clause.text!r} is a place, and nothing that can be moved; "
                f"for what is in or on it, say 'everything from {name.text}'"
            )

    def _take_colour(self, name: Name) -> None:
        if self._phrase.heads and not (self._is_relative or self._is_negated or self._is_copula()):
            self._refuse(name.text)
        list_ = self._phrase.other_colours if self._is_negated else self._phrase.colours
        list_.append(name)
        self._is_relative = self._is_negated = False

    def _is_copula(self) -> bool:
        return stem(self._last) == "be"

    def _take_head(self, name: Name) -> None:
        is_second = self._phrase.is_generic and not name.role("use")
        if self._is_negated or self._is_relative or is_second:
            self._refuse(name.text)
        if name.role("kind", "object", "thing", "use") is None:
            role = name.mentions[0].role
            raise UsageError(f"{name.text!r} is a {role}, and nothing that can be moved")
        before = self._phrase.heads
        if before and before[-1].mentions[0].end != name.mentions[0].start:
            self._refuse(name.text)
        before.append(name)
        self._phrase.is_plural = all(item.is_plural for item in name.mentions)

    def finish(self) -> Clause:
        """Return the clause once all of it is read.

        Raises
        ------
        UsageError
            It ends before its sense does, or says where to more than once.
        """
        clause = self.clause
        if self._preposition or self._is_negated or self._is_relative:
            self._refuse(self._preposition or ("not" if self._is_negated else "that"))
        if clause.left_out and clause.subject.is_empty and clause.quantity == (None, "all:"):
            clause.subject.is_generic = True
        if any(phrase.is_empty for phrase in clause.left_out):
            raise UsageError(f"{clause.text!r} does not say what is left out, by its name")
        generic = [p for p in clause.left_out if p.is_generic and not (p.colours or p.sources)]
        if generic:
            self._refuse("ones")
        if clause.verb == "empty" and clause.target is None:
            self._refuse("empty")
        self._assign_places()
        return clause

    def _assign_places(self) -> None:
        """Decide which places are where from, and which one is where to."""
        clause = self.clause
        sources = [at for at in self._places if at.preposition in _FROM or at.is_relative]
        rest = [at for at in self._places if at not in sources]
        if self._is_nothing:
            if len(rest) != 1 or sources or rest[0].preposition not in _AT or clause.left_out:
                self._refuse("nothing")
            sources, rest, clause.removes = rest, [], True
            clause.quantity = None, "all:"
        to = [at for at in rest if at.preposition in _INTO]
        if len(to) > 1 or (clause.target is not None and rest):
            self._refuse(rest[-1].name.text)
        # "put in the left box the cups on the table": what comes before the things is where to.
        target = next(iter(to or [at for at in rest if at.is_early] or rest[-1:]), None)
        if target is not None:
            clause.target, clause.owner = target.name, target.owner
        sources += [at for at in rest if at is not target]
        if any(at.owner is not None for at in sources):
            self._refuse("of")
        clause.subject.sources = [at.name for at in sources]
        # What is picked off a table is held; what is taken off it is to be anywhere else.
        takes_off = clause.verb != "grasp" and any(at.preposition == "off" for at in sources)
        if clause.target is None and sources and (clause.verb in ("remove", "clear") or takes_off):
            clause.removes = True
        clause.goes_back &= clause.target is None
        if clause.target is not None and clause.verb in _CLEAR:
            self._check_clearing(clause.target)

    def _check_clearing(self, target: Name) -> None:
        clause = self.clause
        if clause.subject.sources or clause.quantity is not None:
            raise UsageError(f"to clear {target.text!r}, name the place and, if need be, its robot")

    def _refuse(self, word: str) -> None:
        raise UsageError(
            f"{word!r} in {self.clause.text!r} is not understood where it stands; "
            f"{self._understood()}"
        )

    def _understood(self) -> str:
        return f"understood: {listed(self._mentions)}"
