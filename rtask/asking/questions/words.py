"""Words of questions: stems, and groups of words that mean the same when people ask robots."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator

__all__ = [
    "STOP",
    "concept",
    "forms",
    "has_synonyms",
    "split_name",
    "stem",
    "uncontracted",
    "words_of",
]

_WORD = re.compile(r"@?\w+(?:[-'’]\w+)*")
_CAMEL = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_IRREGULAR = {
    form: word
    for word, irregular in {
        "be": "am is are was were been being",
        "do": "does did done doing",
        "have": "has had having",
        "hold": "held", "lose": "lost loss losing", "see": "saw seen sees", "meet": "met",
        "take": "took taken taking", "break": "broke broken", "give": "gave given giving",
        "know": "knew known", "find": "found", "stand": "stood", "choose": "chose chosen choosing",
        "can": "could", "run": "ran running", "lie": "lies lying lay lain", "put": "putting",
        "think": "thought", "come": "came coming", "go": "went gone going goes", "get": "got",
        "make": "made making", "bring": "brought", "say": "said says", "fall": "fell fallen",
        "tell": "told", "show": "shown", "let": "letting", "use": "used using uses",
        "heavy": "heavier heaviest", "large": "larger largest", "big": "bigger biggest",
        "wide": "wider widest", "tall": "taller tallest", "high": "higher highest",
        "move": "moved moving", "handle": "handled handling",
        "vessel": "vessels", "box": "boxes", "this": "these",
        "that": "those", "fail": "failure failures", "succeed": "success successes",
    }.items()
    for form in irregular.split()
}  # fmt: skip
_GROUPS = """
robot machine
object thing item article
fail failure unsuccessful unsuccessfully wrong mistake problem trouble struggle
succeed success successful successfully hold work manage secure
try attempt trial tried
grasp grip pick grab seize grasping
hand gripper effector fingers tool
see perceive observe look watch spot sight sighting sense perception seen notice encounter
sensor camera
picture image photo photograph snapshot
where location place position whereabouts locate located spot site
why reason cause ground because motive
first introduce initially earliest
sure confident confidently certain certainty confidence surely overconfident
force strength strongly hard press firmly pressure
kind sort type category class
when date
now current currently present presently latest last moment recently
order sequence timeline history chronicle chronology chronological chronologically log
happen occur action event
contribute contribution give add supply
evidence support basis base rest measure proof show
predict prediction expect expectation prior anticipate forecast
long slow slower longer duration second seconds
often frequent frequently frequency common count many number
refuse refusal decline reject abstain skip
subtask sub-task step part divide decompose consist belong compose
overlap simultaneous simultaneously parallel concurrent concurrently
convert transform transformation conversion
recognise recognize identify recognition identification classify
dataset data
end expire invalid invalidate obsolete outdated
prove proven reliable rely trusted trustworthy
transfer inherit
never nobody none impossible always
new unseen
box bin
learner learning
learn lesson teach taught share sharing reuse
lose drop fall
verdict judge judgement judgment decide decision
speed fast quick
hide hidden latent
weak slippery fragile
produce generate compute plan origin provenance source
vouch claim report assert stand
contradict disagree clash conflict dispute disagreement
capability able ability capable qualify suitable
manipulator manipulate manipulation
room kitchen
move touch handle
content contain inside
pose coordinate coordinates orient orientation
next then afterwards react reaction subsequently
match candidate
low lack lacking insufficient
bytes file
heavy weight weigh payload lift mass kilogram kg
wide width opening size large big tall high height length dimension measurement extent
probable probability likely chance
different another other differ
human people person
everything all
meet met
""".strip().splitlines()
STOP = frozenset(
    re.findall(
        r"\w+",
        "a an the of to in on at by for with from and or be do have it its there this that any "
        "some me my i you your we our us please would could like show list tell let all each every "
        "what which as so than then up out into about over if was will shall may might one ones "
        "they them he she his her their not give need want find get know",
    )
)
"""Words that say little about which question is asked."""


def _fold(text: str) -> str:
    plain = unicodedata.normalize("NFKD", text.casefold())
    return "".join(c for c in plain if not unicodedata.combining(c))


def split_name(name: str) -> list[str]:
    """Return the words of a local name.

    >>> split_name("DrinkingVessel"), split_name("drinkFrom"), split_name("t1")
    (['drinking', 'vessel'], ['drink', 'from'], ['t1'])
    """
    parts = _CAMEL.findall(name)
    has_words = all(len(part) > 1 for part in parts)
    # A part of one letter shows that the name is none of words: a model number, say.
    return [part.lower() for part in parts] if has_words else [name]


def stem(word: str) -> str:
    """Return the stem of a word, good enough to compare words by.

    >>> [stem(word) for word in "grasps tried failing boxes held carries dropped poses".split()]
    ['grasp', 'try', 'fail', 'box', 'hold', 'carry', 'drop', 'pose']
    """
    if word in _IRREGULAR:
        return _IRREGULAR[word]
    for ending, chosen, least in (
        ("ies", "y", 4), ("ied", "y", 4), ("sses", "ss", 5), ("xes", "x", 4), ("shes", "sh", 5),
        ("ches", "ch", 5), ("ing", "", 6), ("ed", "", 5), ("s", "", 4),
    ):  # fmt: skip
        if word.endswith(ending) and len(word) >= least and not word.endswith("ss"):
            return _undoubled(word[: -len(ending)] + chosen, ending in ("ing", "ed"))
    return word


def _undoubled(word: str, was_verb: bool) -> str:
    # Not "passed" or "filled", whose stems end in two.
    if was_verb and len(word) > 3 and word[-1] == word[-2] and word[-1] not in "lsz":
        return word[:-1]
    # "moved" and "moving" have lost an e that "move" has.
    if was_verb and re.search(r"(?:[^aeiou][aiou][cgsvz]|[aeiou]t|ov|iv|us|at|os)$", word):
        return word + "e"
    return word


def _bare(word: str) -> str:
    """Return a stem without the last "e", which the stems of "stored" and "store" do not share."""
    is_kept = len(word) <= 4 or word in STOP or word.startswith("@")
    return word if is_kept else word.removesuffix("e")


_CONCEPTS = {
    _bare(stem(word)): _bare(group.split()[0])
    # Reversed, so that a word of two groups belongs to the first.
    for group in reversed(_GROUPS)
    for word in group.split()
    if word not in STOP
}


def concept(word: str) -> str:
    """Return the word that stands for all that mean the same.

    >>> concept("attempt"), concept("gripper"), concept("mug")
    ('try', 'hand', 'mug')
    """
    bare = _bare(word)
    return _CONCEPTS.get(bare, bare)


def has_synonyms(word: str) -> bool:
    """Return whether a stem belongs to a group of words that mean the same.

    >>> has_synonyms("gripper"), has_synonyms("mug")
    (True, False)
    """
    return _bare(word) in _CONCEPTS


def words_of(text: str) -> list[str]:
    """Return the stems of the words of a text, in order; slots stay.

    >>> words_of("Where is @object?")
    ['where', 'be', '@object']
    """
    return [word if word.startswith("@") else stem(word) for word in raw_words(text)]


def uncontracted(word: str) -> str:
    """Return a word without what is contracted with it.

    >>> [uncontracted(word) for word in ("didn't", "can't", "what's", "mug")]
    ['did', 'can', 'what', 'mug']
    """
    plain = word.replace("’", "'")
    if plain.endswith("n't"):
        return {"ca": "can", "wo": "will", "sha": "shall"}.get(plain[:-3], plain[:-3])
    return plain.partition("'")[0]


def raw_words(text: str) -> list[str]:
    """Return the words of a text in lower case, without accents."""
    return [uncontracted(word) for word in _WORD.findall(_fold(text))]


def forms(words: list[str]) -> Iterator[str]:
    """Yield how a name may be written that a person wrote in these words.

    >>> sorted(set(forms(["red", "mugs"])))[:4]
    ['RED MUG', 'RED MUGS', 'Red Mug', 'Red Mugs']
    """
    last = words[-1]
    # In the singular and as it was written, since either may be the name.
    endings = {last, stem(last.lower())}
    if last.lower().endswith("s"):
        endings.add(last[:-1])
    for ending in endings:
        text = " ".join([*words[:-1], ending])
        yield from (text, text.lower(), text.capitalize(), text.upper(), text.title())
