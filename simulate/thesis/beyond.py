"""What neither thesis has, with a figure or a few each."""

from __future__ import annotations

from functools import partial

from simulate.thesis.entry import Entry

__all__ = ["ENTRIES"]

_shown = partial(Entry, "beyond", "capability", section="", state="shown")

ENTRIES = (
    _shown(
        number="inference",
        shows="what follows, with proofs",
        run="beyond:inference",
        why="both theses store what robots report and look it up. Here an OWL 2 RL reasoner "
        "derives within each commit what follows from it, such as which robot can grasp "
        "what, and every derived statement has a proof whose leaves name who stated "
        "them: `rtask explain`",
    ),
    _shown(
        number="rights",
        shows="what a robot cannot do to the others",
        run="beyond:rights",
        why="in both theses whoever connects may write anything. Here a robot writes facts "
        "under its own name, and no axiom of one robot makes facts of others illegal or "
        "its terms mean something else: docs/security.md",
    ),
    _shown(
        number="lessons",
        shows="lessons from one hand to another",
        run="beyond:lessons",
        why="Gatto's robots share grasps among Naos, Kehoe's recall grasps of one gripper. "
        "Here what one hand learned of a thing serves another kind of hand: `rtask "
        "study sharing`",
    ),
    _shown(
        number="promises",
        shows="chances that hold",
        run="beyond:promises",
        why="Kehoe's qualities rank grasps; whether .8 holds in eight of ten was not asked. "
        "Here a chance is promised of each pick, from maps fitted on other things, and "
        "is compared with what held: `rtask study grasp-quality`",
    ),
    _shown(
        number="plans",
        shows="plans with reasons, repaired",
        run="beyond:plans",
        why="Gatto's ontology has tasks and writes them down afterwards. Here a goal in "
        "words becomes a plan whose steps have their reasons in the graph, for several "
        "robots, and is planned again when something comes between: `rtask plan`, "
        "`rtask study tasks`",
    ),
    _shown(
        number="places",
        shows="a common memory of where things are",
        run="beyond:places",
        why="Gatto's engine knows where a thing stood when it was last looked at; Kehoe names a "
        "shared environment as work to come (6.2). Here every place has a begin, an end, a "
        "frame and an uncertainty that grows, and a robot asks where something is, was, and who "
        "moved it: docs/world.md, `rtask study day`",
    ),
)
"""In the order in which a reader meets them; the reason of each is a paragraph for the report."""
