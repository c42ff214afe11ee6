"""Words around the slots of a goal: those that add nothing, and those that may not be dropped."""

from __future__ import annotations

from rtask.tasks.language.lexicon import GRASP, PUT, TAKE

__all__ = ["BLOCKING", "DETERMINERS", "MOVEMENT", "NOT_YET", "RELATIVES", "SILENT", "WISHES"]

BLOCKING = frozenset(
    ("not", "no", "never", "neither", "nor", "without", "none", "nothing", "nobody",
     "nowhere", "unless", "if", "when", "whenever", "until", "till", "while", "or",
     "either", "except", "but", "apart", "besides", "only", "avoid", "instead", "rather",
     "twice", "again", "every", "each", "always", "daily", "hourly", "sometimes", "myself",
     "ourselves", "yourself", "himself", "herself", "themselves", "who", "whoever", "whom",
     "whose", "why", "how", "what", "which", "whether", "did", "does", "was", "were", "had",
     "has", "used", "been", "gone", "took", "went", "broke", "fell", "gave", "dropped",
     "ago", "yesterday", "already", "leave", "leaves", "leaving", "keep", "keeps", "stay",
     "stays", "remain", "remains", "tell", "ask", "remind", "wait", "report", "show",
     "count", "check", "know", "guess", "wonder", "before", "after", "during", "once",
     "half", "third", "quarter", "most", "few", "some", "many", "much", "percent", "both",
     "same", "other", "others", "another", "rest", "swap", "exchange", "between", "least",
     "last", "tomorrow", "tonight", "monday", "tuesday", "wednesday", "thursday", "friday",
     "saturday", "sunday", "stop", "stops", "refuse", "forbid", "prevent", "hate", "empty",
     "forget", "forgot", "impossible", "pretend", "imagine", "said", "says", "told", "hope",
     "hopes", "nearly", "almost", "emptied", "clear", "cleared", "fill", "filled", "tidy", "tidied")
)  # fmt: skip
"""Negation, scope, conditions, times, questions and the past: dropped, they change the goal."""
DETERMINERS = frozenset(
    ("the", "a", "an", "my", "your", "his", "her", "its", "our", "their", "that", "this",
     "these", "those", "one", "any", "second", "third")
)  # fmt: skip
RELATIVES = frozenset(
    ("that", "which", "who", "whom", "you", "i", "we", "he", "she", "they")
)  # fmt: skip
"""What begins a clause about the thing before it."""
_HOME = frozenset(
    ("live", "belong", "go", "end", "find", "wander", "travel", "migrate", "land", "head",
     "want", "come", "make", "get")
)  # fmt: skip
MOVEMENT = PUT | TAKE | GRASP | _HOME
"""Verbs that bring about, or state, where things are to be."""
NOT_YET = frozenset(("is", "are", "am"))
"""What is so now, as a rule; "the right box is where the bottles go" is the exception."""
SILENT = frozenset(
    ("a", "an", "the", "this", "that", "these", "those", "would", "should", "must", "shall",
     "can", "could", "might", "ought", "to", "be", "being", "up", "over", "across", "along",
     "down", "out", "away", "of", "for", "and", "so", "please", "also", "too", "just",
     "now", "then", "here", "there", "it", "them", "they", "i", "we", "you", "me", "us",
     "like", "love", "need", "wish", "prefer", "let", "have", "having", "see", "better",
     "off", "best", "found", "kept", "sitting", "standing", "lying", "going", "way",
     "their", "good", "happy", "sure", "by", "oh", "hey", "hi", "ok", "okay", "well",
     "thanks", "with", "feel", "require", "somebody", "someone", "directly", "straight",
     "right", "through")
)  # fmt: skip
"""Function words and wishes: what is wished is said by the slots."""
WISHES = frozenset(
    ("want", "need", "like", "love", "wish", "prefer", "would", "should", "could", "must",
     "require")
)  # fmt: skip
"""What follows "I" and "we" in a wish; with another verb they tell something about themselves."""
