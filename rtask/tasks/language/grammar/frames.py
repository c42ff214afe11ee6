"""Grammar of what people say around a goal: requests, wishes and courtesy."""

from __future__ import annotations

from collections.abc import Iterator

from rtask.tasks.language.items import Items

__all__ = ["courtesies", "requests", "wishes"]

_COURTESY = (
    "please|kindly|thanks|hey|hello|hi|ok|okay|so|well|now|just|robot|dear|pls|plz|yo|oh|alright",
    "mate|sir|cheers|also|right|actually|ta|hiya|yeah|yes|oi|folks|team|everyone",
    "again|immediately|asap|task|goal|job|todo|order|request|instruction",
    "good morning|afternoon|evening|day", "thank you very? much?", "many thanks",
    "much appreciated", "thanks in advance|a? lot|bunch|million|so? much?",
    "as soon as possible|you can", "that is all|it",
    "maybe|perhaps|possibly|ideally|preferably|simply|somehow|basically|thx|tia|"
    "love|duck|darling", "it|that does not matter which|how?", "does not matter which|how?",
    "no matter which|how", "I|we do not mind|care which|how?", "by the end", "any more",
    "anymore|anyway|too", "when|whenever it suits you|everyone?", "at the moment",
    "whichever is quicker|easier|closer|faster|simpler", "whichever you like|prefer|want",
    "your choice", "either will do", "any will do", "only if possible",
    "if that|it is okay|ok|alright|fine|possible|convenient", "with? no hurry|rush",
    "when|whenever|if|once you have|get|find got? a|some? chance|moment|minute|second|time|sec",
    "when|whenever|once you are ready|free|able|done|finished", "no rush|hurry , but",
    "sorry to bother|trouble you",
    "excuse me", "sorry ,? but?", "for now", "would|will that be alright|ok|okay|possible|fine",
    "if you can|could|may", "one more thing",
    "I|we think|believe|guess|suppose|reckon|feel that?",
    "your|the|my|our task|goal|job|order|request|aim|objective is to|that?", "in the end",
    "one|two|three at|by a|one time?", "if you would not mind|be so kind",
    "there is a? good robot|boy|girl|lad", "at your|the earliest? convenience", "all right",
    "by the way", "to start|begin with", "I beg you", "quick one", "you two|all|both|lot|guys",
    "thank you", "hey|hello|hi robot", "would|could|will AGENT", "right now", "as well",
    "at once", "if you please", "for me", "be a dear and",
    "if it is|would not be? too much? of? a? trouble|bother|hassle|work|effort|ask",
    "if you do not mind", "if possible", "tidy|tidying up :", "time to tidy up :",
)  # fmt: skip
_SURELY = (
    "I would? need|want you to make sure|certain that?", "make sure|certain that?",
    "ensure that?", "see to it that", "make that", "take care that",
)  # fmt: skip
_REQUESTS = (
    "please? to", "make|be sure to|and", "I would be NICE if you",
    "is there? any chance you could|can|would", "any chance you could|can|would",
    "it is? time to", "you may|can now?", "let us", "go ahead and", "do", "do the needful and",
    "be so NICE and", "can|could|will|would AGENT POLITE*", "would you mind",
    "is|would it be? possible to", "the robot|robots MUST|can|has|have to?", "it MUST",
    "AGENT MUST|can|could POLITE*", "might|may|can|could I ask you to",
    "I would appreciate it if you could|would POLITE*", "I would appreciate it if you",
    "would|could|can|will AGENT be so NICE|good as to", "be so good as to",
    "I was|am|were wondering if|whether it would|might|could be? possible for you? to",
    "it would|might|may be NICE|possible|good for you? to", "is it possible for you to",
    "would|could|might it be possible for you? to", "would you care to",
    "could|can|may I get|ask|trouble you to", "you will need|have to", "I insist that? you?",
    "would you be so NICE as to", "be so NICE as to", "I would? WANT you? to", "I would WANT you",
    "I would? WANT that you", "I would be most|very|so? NICE if you could|would POLITE*",
    "it would be very|so? NICE if you could|would POLITE*",
    "I was|am|were wondering if|whether you could|would|might POLITE*",
    "it is necessary|important|time to", "you are asked|requested|supposed to",
    "you have|need to", "I would ask you to",
    "I was|am|were hoping|thinking|wondering that|if? you could|might|would POLITE*",
    "I was|am|were hoping|wondering that|if? you could|might POLITE* find the? time to",
    "I was|were going to ask you to", "would|could|can|will you be able to", "are you able to",
    "I need|want|expect you? to", "we need|want|have you? to", "can|could|shall we? POLITE*",
    "could|can|may|might we|I get|have you to",
    "you could|can|may|should|must|might now? POLITE*", "try to|and",
    "do me a favour|favor and|,", "would you do me a favour|favor and",
    "it would help me|us? if you could|would?", "how about you?", "why do not you|we",
    "be a good|nice|dear robot|sport|one|dear? and", "be a star|love|darling|sport and",
    "the robot|robots needs|is|are to?", "it is time to", "start by", "begin by", "proceed to",
    "remember to", "do not forget to", "feel free to", "go and", "if you could|would|can POLITE*",
    "you are to", "please do", "help me|us to?", "go", "what I|we need|want is for you to",
    "all I|we need|want is for you to", "all you have|need to do is to?",
)  # fmt: skip
"""What can stand before a verb."""
_WISHES = (
    "I would? WANT that?", "I would WANT", "I would? WANT for", "I would like for",
    "I would? need|want you to make sure|certain that?", "make sure|certain that?",
    "ensure that?", "see to it that", "make that", "take care that",
    "I would? WANT to have|see|find", "let", "have", "get", "make it so that?", "so that",
    "arrange for", "see that", "see to it", "check that", "I|we would? require that?",
    "it would be very|so? NICE if", "I would be NICE if", "it would be very|so? NICE for",
    "it would be very|so? NICE to have|see", "let us have",
    "I|we|you must|should|shall|will|would have",
    "can|could|may|might I|we|you POLITE* have|get|see", "what I|we need|want is that?",
    "the goal|aim|objective|target|plan is that?",
    "the goal|aim|objective|target|plan is to have|get|see", "in the end ,?", "at the end ,?",
    "arrange|see that|for", "I|we need|want to have|see|find|get", "I|we expect that?",
    "I|we expect to see|find", "it is important|necessary|essential that", "I will have",
    "goal|target|wanted state ,?|:?", "is|would it be? possible to have",
)  # fmt: skip
"""What can stand before a state that is to be."""


def courtesies(items: Items, at: int) -> Iterator[int]:
    """Yield the words where a goal goes on after what is only polite; this one first."""
    pending, seen = [at], {at}
    while pending:
        start = pending.pop(0)
        yield start
        for pattern in _COURTESY:
            begins = (start, *items.ends(start, ","))
            for end in (end for begin in begins for end in items.ends(begin, pattern)):
                for after in (end, *items.ends(end, ",|:|!|.")):
                    if after not in seen and after > start:
                        seen.add(after)
                        pending.append(after)


def requests(items: Items, at: int) -> Iterator[int]:
    """Yield the words where a deed can begin: here, and after a request."""
    seen: set[int] = set()
    for start in courtesies(items, at):
        for begin in (start, *(end for pattern in _REQUESTS for end in items.ends(start, pattern))):
            for end in courtesies(items, begin):
                if end not in seen:
                    seen.add(end)
                    yield end


def wishes(items: Items, at: int) -> Iterator[int]:
    """Yield the words where a state can begin that is wished."""
    seen: set[int] = set()
    for start in courtesies(items, at):
        for pattern in _WISHES:
            for end in items.ends(start, pattern):
                if end not in seen:
                    seen.add(end)
                    yield end
