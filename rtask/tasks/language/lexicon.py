"""Words of goals by what they do in a sentence, and units of measures."""

from __future__ import annotations

import re

__all__ = [
    "ADJECTIVES", "AWAY", "CLASSES", "GRASP", "MEASURES", "NUMBERS", "PUT", "SHARES", "STAYING",
    "TAKE", "UNITS", "expanded",
]  # fmt: skip

PUT = frozenset(
    ("move", "put", "bring", "place", "get", "carry", "store", "sort", "drop", "lay", "set", "hand",
     "pass", "fetch", "give", "grab", "take", "transfer", "relocate", "shift", "stick", "chuck",
     "pop", "transport", "deposit", "consolidate", "gather", "collect", "return", "throw",
     "deliver", "pack", "send", "dump", "toss", "haul", "tuck", "stow", "stash", "ship", "ferry",
     "cart", "lug", "shove", "plonk", "plop", "bung", "park", "position", "dispatch", "slide",
     "convey", "drag", "rehome", "sling", "slip",
     "redistribute", "group", "assemble", "bundle", "rest", "stand")
)  # fmt: skip
"""Verbs after which things are somewhere else."""
GRASP = frozenset(["hold", "grasp", "grip", "pick", "lift"])
TAKE = frozenset(["take", "get", "grab", "pick", "fetch", "lift"])
"""Verbs that may begin "take it and put it there"."""
AWAY = frozenset(["take", "get", "grab", "fetch", "throw", "bring", "move", "put"])
"""Verbs that take things off a place; what is lifted out of a box may be meant to be held."""
NUMBERS = {
    "one": 1, "two": 2, "three": 3, "four": 4, "five": 5, "six": 6, "seven": 7, "eight": 8,
    "nine": 9, "ten": 10, "eleven": 11, "twelve": 12, "fifteen": 15, "twenty": 20, "thirty": 30,
    "forty": 40, "fifty": 50, "sixty": 60, "ninety": 90,
}  # fmt: skip
SHARES = {"half": 1 / 2, "third": 1 / 3, "quarter": 1 / 4}
STAYING = (
    "alone|untouched|unmoved|undisturbed|be|there", "in place", "in its|their place|places|spot",
    "where|wherever it|they is|are currently|now?", "where|wherever it|they LIE",
    "as it|they is|are", "just? there|here", "on|in it|there", "exactly where it|they is|are",
    "put",
    "right? where it|they is|are", "at its|their place|places", "out", "behind",
)  # fmt: skip
"""What follows things that are to stay: "leave the jug where it is"."""
MEASURES = {"mass": "rt:effectiveMass", "height": "rt:extentZ", "width": "rt:graspWidth",
            "size": ""}  # fmt: skip
"""Measures of things, with the property that has them; a size is the volume of the extents."""
ADJECTIVES = {
    "heavier": ("mass", True), "heaviest": ("mass", True),
    "lighter": ("mass", False), "lightest": ("mass", False),
    "taller": ("height", True), "tallest": ("height", True), "higher": ("height", True),
    "highest": ("height", True), "shorter": ("height", False), "shortest": ("height", False),
    "lower": ("height", False), "lowest": ("height", False),
    "wider": ("width", True), "widest": ("width", True), "narrower": ("width", False),
    "narrowest": ("width", False), "thinnest": ("width", False), "thickest": ("width", True),
    "larger": ("size", True), "largest": ("size", True), "bigger": ("size", True),
    "biggest": ("size", True), "smaller": ("size", False), "smallest": ("size", False),
}  # fmt: skip
UNITS = {
    unit: (measure, factor)
    for measure, units in (
        ("mass", {"kg": 1.0, "g": 1e-3, "mg": 1e-6, "kilo": 1.0, "kilos": 1.0, "gram": 1e-3,
                  "grams": 1e-3, "kilogram": 1.0, "kilograms": 1.0, "gramme": 1e-3,
                  "grammes": 1e-3}),
        ("length", {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "metre": 1.0, "metres": 1.0, "meter": 1.0,
                    "meters": 1.0, "centimetre": 1e-2, "centimetres": 1e-2, "centimeter": 1e-2,
                    "centimeters": 1e-2, "millimetre": 1e-3, "millimetres": 1e-3,
                    "millimeter": 1e-3, "millimeters": 1e-3}),
    )
    for unit, factor in units.items()
}  # fmt: skip
CLASSES = {
    name: frozenset(words.split())
    for name, words in {
        "DET": "the these those this that our",
        "I": "i we",
        "MODAL": "can could will would might may shall should",
        "MUST": "must should shall",
        "BE": "be is are",
        "POLITE": "please kindly just possibly simply also pls plz perhaps",
        "AGENT": "you u somebody someone anybody anyone",
        "NICE": "nice great good lovely kind helpful grateful glad happy thankful appreciated",
        "STAY": "stay remain be lie stand sit rest left kept live",
        "LIE": "left remaining lie lies lying stand stands standing sit sits sitting located "
        "placed stored",
        "PLACED": "put placed moved kept brought stored laid transferred shifted taken carried "
        "positioned relocated returned packed stowed loaded set dropped popped delivered sent "
        "shipped sorted tidied gathered collected dumped located lying standing sitting",
        "WANT": "want need like love wish prefer require",
        "INTO": "into onto to inside",
        "AT": "in on at inside upon",
        "OFF": "from off",
        "THING": "thing things object objects item items stuff bits pieces goods articles "
        "belongings gear bit piece article",
        "CONTAIN": "contains holds has",
        "EMPTY": "empty clear free cleared emptied",
        "TOUCH": "touch move disturb handle displace shift take pick grab lift bother remove "
        "relocate",
        "TOUCHING": "touching moving disturbing handling displacing shifting taking picking "
        "grabbing lifting bothering removing relocating",
        "TOUCHED": "touched moved disturbed handled displaced shifted taken picked grabbed lifted "
        "removed relocated move",
        "TASK": "task job work goal",
        "LATER": "then afterwards later next finally lastly subsequently thereafter afterward",
    }.items()
}
"""Classes of words by the name that grammars have for them."""
_CONTRACTED = (
    (r"\bcan['’]t\b", "can not"), (r"\bwon['’]t\b", "will not"), (r"\bgimme\b", "give me"),
    (r"n['’]t\b", " not"), (r"\blet['’]s\b", "let us"), (r"\b(i|we)['’]d\b", r"\1 would"),
    (r"\b(it|that|you|they)['’]d\b", r"\1 would"), (r"['’]ve\b", " have"),
    (r"\b(that|what)s\b", r"\1 is"), (r"\b(do|does|did|is|are|was|were)nt\b", r"\1 not"),
    (r"['’]re\b", " are"), (r"['’]ll\b", " will"),
    (r"\b(it|that|there|what|whatever|who|where)['’]s\b", r"\1 is"),
)  # fmt: skip
_SPELT = (
    (r"\b(\d+)\s?x\s+(?=[a-z])", r"\1 "),
    (r"(?<=\s)[:;]-?[)D(P](?=\s|$)", ""), (r"\s+[-–—]+\s+", " , "),
    (r"\b(?:the\s+)?(\w+(?:[ -]\w+)?)['’]s contents\b", r"the contents of the \1"),
    (r"->|=>|→", " : "), (r"(\d)\s*%", r"\1 percent"),
    (r"\b(\d+(?:\.\d+)?)(kg|g|cm|mm)\b", r"\1 \2"),
    # "the left or the right box" and "the box on the left" have the names of the places in them.
    (r"\b(left|right)\s+or\s+(?:the\s+)?(left|right)\s+(\w+)", r"\1 \3 or \2 \3"),
    (r"\b(box|half|part|table|shelf|bin|tray)\s+(?:on|of|at|to) the (left|right)"
     r"(?=\s*(?:$|[,;.!]|\b(?:and|then|into|onto|from|in|on|to)\b))", r"\2 \1"),
)  # fmt: skip


def expanded(text: str) -> str:
    """Return a sentence without contractions and signs.

    >>> expanded("I'd say cups -> left or right box, 50%")
    'I would say cups  :  left box or right box, 50 percent'
    """
    for pattern, replacement in (*_CONTRACTED, *_SPELT):
        text = re.sub(pattern, replacement, text, flags=re.I)
    noun = re.search(r"\b(?:left|right) (?!one\b)(\w+)", text, flags=re.I)
    if noun is not None:  # "the pens in the left box, the cups in the right one"
        text = re.sub(r"\b(left|right) one\b", rf"\1 {noun[1]}", text, flags=re.I)
    return text
