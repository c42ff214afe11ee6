"""Questions that no question of the ontology answers, although one has words in common with them.

What a person asks may deny what the question states, tell a robot to do something, ask about what
might be, or be about something else altogether. An answer to the nearest question would then be one
to another question, and a list of what is so says nothing about what is not.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence, Set

from rtask.asking.questions.catalogue import Phrase
from rtask.asking.questions.forms import other_form
from rtask.asking.questions.words import STOP, concept, raw_words, stem

__all__ = ["command", "superlatives", "unanswerable"]

_NOT = re.compile(r"n['’]t\b|\bcannot\b", re.I)
_NO_DENIAL = re.compile(
    r"\b(?:or not|no longer|no more|not only|not yet|whether or not|if not)\b|"
    r"\bnot\b(?=.*\bany ?(?:more|longer)\b)",
    re.I,
)
_POLITE = re.compile(
    r"^(?:(?:please|kindly|now|hey|ok|and|then)\b[\s,]*|(?:could|can|would|will) you\b\s*|"
    r"[\w-]+,\s+(?=\w+ (?:the|a|an|this|that|my|me)\b)|let [\w-]+\s+)*",
    re.I,
)
_MOST = re.compile(
    r"(?:larg|bigg|wid|tall|high|small|light|thick|long|short|strong|weak|fast|slow"
    r"|cheap|hard|near|eas|heav)i?est|worst"
)
_WISH = re.compile(r"\b(?:some|any)thing\b|\bsth\b", re.I)
_MIGHT_BE = re.compile(
    r"\bwould\b.*\bif\b|\bif\b.*\bwould\b|^what if\b|\btomorrow\b|"
    r"^when (?:is|are|do|does)\b.*\bnext\b|"
    r"\bnext (?:hour|day|week|month|year)\b|\bin (?:the )?future\b",
    re.I,
)


def _words(text: str) -> frozenset[str]:
    return frozenset(re.findall(r"\w+", text))


def _concepts(text: str) -> frozenset[str]:
    return frozenset(concept(stem(word)) for word in _words(text))


_DENIALS = _words("not no never nobody none nothing without lack lacking neither nor")
_INTERROGATIVES = _words("who whom whose how when where why which what")
_VAGUE = _INTERROGATIVES | _concepts(
    "robot object thing often count two three now itself themselves still very here again also "
    "somebody someone anybody anyone anything something everything just actually exactly ever yet "
    "already more most only really"
)
"""Concepts that occur in questions about anything."""
_VAGUE_ROLES = frozenset({"@object", "@kind", "@robot", "@place", "@time"})
_HANDLED = _concepts("grasp hold take move use try work")
"""Concepts of handling; who has not held a thing has not taken it, either."""
_ACTS = _words(
    "bring clean close deliver drive drop fetch go grab grasp hand hold lift move open pass pick "
    "place pull push put release remove delete stop take teach throw turn carry"
)
_ONLY_ACTS = _words("bring deliver fetch grab put remove delete throw carry take teach stop")
"""Of these, those that are no nouns and no adjectives, either."""
_DIRECTED = _words("the a an this that these those my your me us him her it all")
_LACKING = _concepts("lack lacking")
_ASKS = re.compile(
    r"^(?:who|whose|what|which|when|where|why|how|is|are|was|were|do|does|did|can|could|has|have|"
    r"will|may)\b",
    re.I,
)
_IS_SO = re.compile(r"^(?:is|are|was|does|do|did|has)\b(?! (?:there|we|you|i|any)\b)", re.I)
_POINTS = re.compile(r"\b(?:this|that|it)\W*$", re.I)
MAX_SHORT, MAX_MIDDLING = 7, 9
"""Words of a question that has hardly room for what could be left out, and of one with little."""
MAX_POINTING = 5
"""Words of a question that has no room for what "it" refers to."""
UNSURE, DOUBTFUL = 0.7, 0.5
"""Likeness below which each word of a short question has to be one of the nearest question's, and
below which each of a middling one has to."""
_LOOSE = _concepts(
    "see lie around find lab here guy currently please all right always typical true everybody "
    "everyone once behind together finally even whether per usually so far please today earlier "
    "this whose well too top good bad think exist enough kind much"
)
_NO_TOPIC = _words("can will may go come make be do have happen")


def command(text: str) -> bool:
    """Return whether words tell a robot to do something, rather than ask.

    >>> [command(text) for text in ("Bring me the mug", "please pick up the pen", "grasp g3")]
    [True, True, False]
    >>> [command(text) for text in ("Can you hand me the pen?", "Bring me something to drink from")]
    [True, False]
    """
    words = re.findall(r"[\w'-]+", _POLITE.sub("", text.strip()).lower())
    if len(words) < 2 or words[0] not in _ACTS or _WISH.search(text) or "through" in words[:3]:
        return False  # "take me through the attempts" asks
    after = words[2] if words[1] in ("up", "away", "down") and len(words) > 2 else words[1]
    is_polite = _POLITE.match(text.strip())
    return after in _DIRECTED or words[0] in _ONLY_ACTS or bool(is_polite and is_polite[0])


def superlatives(text: str, question: str) -> list[str]:
    """Return superlatives that a question does not have: its answer is about all.

    >>> superlatives("What is the heaviest carton?", "How heavy is each object?")
    ['heaviest']
    """
    own = raw_words(question)
    return [word for word in raw_words(text) if _MOST.fullmatch(word) and word not in own]


def unanswerable(
    text: str, words: Sequence[str], names: Iterable[str], strange: Iterable[str],
    phrases: Sequence[Phrase], likeness: float, roles: Set[str] = frozenset(),
) -> str:  # fmt: skip
    """Return why a question is not the one that is nearest, or nothing.

    Parameters
    ----------
    text
        The question as it was asked.
    words
        Its stems, and ``@role`` for what it names.
    names
        Stems that belong to names.
    strange
        Words that mean nothing in any question, as they were written.
    phrases
        The nearest question in its phrasings.
    likeness
        Of the question to these.
    roles
        Roles that the things named can fill.
    """
    if _POINTS.search(text) and len(raw_words(text)) <= MAX_POINTING and not names:
        return "What is meant by the last word is not said: a name says it."
    if _MIGHT_BE.search(text):
        return "The graph states what was and what is, not what would or will be."
    named = frozenset(names)
    if denied := _denied_alone(text, named, phrases):
        return (
            f"The nearest question is not about what is denied ({denied!r}): the graph states what "
            "is known, and what is not known is not denied."
        )
    own = {concept(word) for item in phrases for word in item.words}
    content = [
        word for word in words
        if not word.startswith("@") and word not in named
        and word not in STOP and concept(word) not in STOP
    ]  # fmt: skip
    if set(words) <= STOP | _INTERROGATIVES:
        return "Nothing in these words says what is asked for."
    shared = [w for w in content if concept(w) in own and concept(w) not in _VAGUE]
    shared += [w for w in words if w.startswith("@") and w in own and w not in _VAGUE_ROLES]
    strange = [word for word in strange if concept(stem(word)) not in _VAGUE]
    if strange and not shared:
        return f"None of the questions is about {strange[0]!r}."
    if "@use" in words and _IS_SO.match(text.strip()):
        return "Whether something is so is not what the nearest question asks."
    if why := other_form(text, phrases, roles):
        return why
    if topic := _other_topic(text, content, own, strange):
        return f"The nearest question is not about {topic!r}."
    if left := _left_out(text, content, own, likeness):
        return f"None of the questions is about {left!r} here."
    return ""


def _left_out(text: str, content: Sequence[str], own: set[str], likeness: float) -> str:
    """Return a word of a short question that the nearest one does not have, or nothing.

    "How old is nao?" is not near to what is asked of nao otherwise. Keywords are no sentence, and a
    long question says in many words what a phrasing says in few.
    """
    words = raw_words(text)
    if len(words) > MAX_MIDDLING or "," in text or not _ASKS.match(text.strip()):
        return ""
    if likeness >= (UNSURE if len(words) <= MAX_SHORT else DOUBTFUL):
        return ""
    left = [word for word in content if concept(word) not in own | _LOOSE | _VAGUE | _NO_TOPIC]
    if words[:2] == ["how", "many"] and words[2:3] != ["times"] and len(words) <= MAX_SHORT:
        left = [word for word in left if word != stem(words[2])]  # counted or not elsewhere
    written = {stem(word): word for word in words}
    return next((written.get(word, word) for word in left), "")


def _denied_alone(text: str, names: Set[str], phrases: Sequence[Phrase]) -> str:
    """Return what a question denies and no phrasing does, or nothing."""
    own = {concept(word) for item in phrases for word in item.words}
    denied = _denied(text, names, own & _LACKING)
    if not denied:
        return ""
    also = {concept for item in phrases for concept in _denied(item.text, _names(item))}
    is_handled = bool(also & _HANDLED)
    for item, words in denied.items():
        if item not in also and not (item in _HANDLED and is_handled):
            return words
    return ""


def _names(item: Phrase) -> Set[str]:
    return {stem(word) for _, words, _ in item.filled for word in raw_words(words)}


def _denied(text: str, names: Set[str], lacked: Set[str] = frozenset()) -> dict[str, str]:
    """Return the concept after each denial, rather than the name there, with its words.

    What is ``lacked`` in a question itself ("which confidence was lacking?") is no denial.
    """
    words = raw_words(_NO_DENIAL.sub(" ", _NOT.sub(" not ", text)))
    result = {}
    for at, word in enumerate(words):
        if stem(word) not in _DENIALS or concept(stem(word)) in lacked:
            continue
        following = [
            other for other in words[at + 1 :]
            if stem(other) not in STOP and concept(stem(other)) not in _VAGUE | _NO_TOPIC
            and stem(other) not in _DENIALS
        ]  # fmt: skip
        following.sort(key=lambda other: stem(other) in names)
        if following:
            result[concept(stem(following[0]))] = f"{word} … {following[0]}"
    return result


def _other_topic(text: str, content: Sequence[str], own: set[str], strange: Sequence[str]) -> str:
    """Return the noun after "which", if other questions are about it; or nothing."""
    words = raw_words(text)
    for before, word, after in zip(words, words[1:], [*words[2:], ""], strict=False):
        noun = stem(word)
        if (
            before == "which" and noun in content and word not in strange
            and concept(noun) not in own | _VAGUE | _NO_TOPIC
            and (stem(after) in STOP or concept(stem(after)) not in own)  # no adjective
        ):  # fmt: skip
            return word
    return ""
