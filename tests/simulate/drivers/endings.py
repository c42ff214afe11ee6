"""How the goals of an arm end that lies: ``status``, and what becomes of the arm meanwhile.

Text stands for goals that do not end. ``stays``, ``freezes`` and ``state`` say where the arm and
its states are afterwards, ``goes`` how an arm moves that takes its time.
"""

from __future__ import annotations

SUCCEEDED = {1: 3, 2: 4}
ENDS = {
    "good": lambda ok: {"status": ok},
    "canceled by another program": lambda ok: {"status": {3: 2, 4: 5}[ok]},
    "aborted": lambda ok: {"status": {3: 4, 4: 6}[ok]},
    "rejected": lambda ok: {"status": 5} if ok == 3 else {"status": 4, "result": False},
    "an unknown status": lambda ok: {"status": 42},
    "success of the other version": lambda ok: {"status": 7 - ok},
    "an error code": lambda ok: {"status": ok, "code": -4},
    "success, but it stayed": lambda ok: {"status": ok, "stays": True},
    "success, but it stopped short": lambda ok: {"status": ok, "freezes": 0.06},
    "the end of another's goal": lambda ok: {"status": ok, "of": "theirs"},
    "success twice": lambda ok: {"status": ok, "times": 2},
    "success at once": lambda ok: {"status": ok, "at once": True},
    "feedback and no end": lambda ok: "feedback",
    "no end": lambda ok: "silent",
    "no end, and states that stop": lambda ok: "states stop",
    "no end, and joints get other names": lambda ok: "renamed",
    "no end, and it goes on when cancelled": lambda ok: "unannounced motion",
    "success, but it goes on": lambda ok: {"status": ok, "state": "unannounced motion"},
    "success, and the time jumps back": lambda ok: {"status": ok, "state": "old"},
    "success of a twin on the topic": lambda ok: {
        "status": ok,
        "stays": True,
        "state": "a twin ahead of it between",
    },
    "failure, then success": lambda ok: {"status": {3: 4, 4: 6}[ok], "then": {"status": ok}},
    "a status in words": lambda ok: {"status": "SUCCEEDED"},
    "a status that is true": lambda ok: {"status": True},
    "an error code in words": lambda ok: {"status": ok, "code": "GOAL_TOLERANCE_VIOLATED"},
    "success, and NaN in one joint": lambda ok: {"status": ok, "state": "NaN"},
    "success, and one joint drops out": lambda ok: {"status": ok, "state": "incomplete"},
    "success, and the time steps back": lambda ok: {"status": ok, "state": "two seconds old"},
    "success after a detour": lambda ok: {"status": ok, "goes": "aside"},
    "success of a mirrored motion": lambda ok: {"status": ok, "goes": "mirrored"},
    "success, with states sent again": lambda ok: {"status": ok, "goes": "unseen"},
    "no end, as its controller was switched": lambda ok: {"status": ok, "goes": "half"},
    "no end, and NaN in one joint": lambda ok: "NaN",
    "no end, and one joint drops out": lambda ok: "incomplete",
    "canceled, and it goes on": lambda ok: {
        "status": {3: 2, 4: 5}[ok],
        "state": "unannounced motion",
    },
    "a status of 0": lambda ok: {"status": 0},
    "an error code beside success": lambda ok: {"status": ok, "code": -1},
}
"""What a goal's end is, by the number that means success."""
