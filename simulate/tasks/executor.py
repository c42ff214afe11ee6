"""One robot carries out steps of stored plans: claim, look, act, report, end.

Where a plan has prices of asking and of failing, it asks people about steps that are likely to fail
and takes other steps until they answer. Whatever it did last, it can be killed anywhere and started
again: it gets the step that it had, and looks first whether that was done. Reports
have ids made of the step, so that each is stored once.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol

from rtask.errors import ConflictError, RemoteUnavailableError, RtaskError
from rtask.rdf.namespaces import PREFIXES
from rtask.tasks.queue.asking import PATIENCE_S
from simulate.tasks.actions import TaskAction, available_actions
from simulate.tasks.body import Attempted, Deed, Seeing, TaskBody, Watching
from simulate.tasks.questions import Reply, about_acting, about_place, read_reply

__all__ = ["Executor", "Graph", "Turn", "line_of"]

_LEASE_S = 300.0


class Graph(Protocol):
    """Calls of operations; clients of :func:`rtask.connect` have it."""

    def call(self, operation: str, timeout_s: float | None = None, /, **args: Any) -> Any:
        """Carry out an operation."""

    def query(self, sparql: str) -> list[dict[str, Any]]:
        """Return the rows of a SELECT."""


@dataclass(frozen=True)
class Turn:
    """What came of asking for a step once.

    Parameters
    ----------
    result
        done, failed, declined, lost (the claim went to another robot), asked (the step waits for a
        person), released (a person said where the thing is); idle without a step.
    task, text, comment
        The step, and what happened.
    stuck
        Plans, by IRI, whose next step can never be begun.
    taken
        What other robots took over from this one since the last turn, each with who has it and why.
    """

    result: str
    task: str = ""
    text: str = ""
    comment: str = ""
    stuck: tuple[str, ...] = ()
    taken: tuple[str, ...] = ()

    def records(self, robot: str) -> list[dict[str, str]]:
        """Return what the robot lost to others and what it did, each as JSON-able values."""
        lost = [("taken_over", text, "") for text in self.taken]
        done = [] if self.result == "idle" else [(self.result, self.text, self.comment)]
        return [
            {"robot": robot, "result": result, "step": text, "comment": comment}
            for result, text, comment in (*lost, *done)
        ]


def line_of(record: Mapping[str, str]) -> str:
    """Return what a robot did, or lost to another one, as a line for people."""
    comment = f"  ({record['comment']})" if record["comment"] else ""
    return f"{record['result'].replace('_', ' ')}: {record['step']}{comment}"


class Executor:
    """Carries out steps for one robot.

    Parameters
    ----------
    graph
        A client in the name of the robot.
    body
        The robot.
    robot
        Its name or IRI, where the client has no name.
    may
        Asks a person whether a step may be carried out; by default nobody objects.
    actions
        What it can carry out, by the IRI of the class; None = all that is installed.
    patience_s
        How long a step waits for the answer of a person.
    """

    def __init__(
        self,
        graph: Graph,
        body: TaskBody,
        robot: str | None = None,
        may: Callable[[str], bool] = lambda text: True,
        actions: Mapping[str, TaskAction] | None = None,
        patience_s: float = PATIENCE_S,
    ) -> None:
        self.graph, self.body, self.robot, self._may = graph, body, robot, may
        self.actions = available_actions() if actions is None else actions
        self._patience_s = patience_s
        self._acted: tuple[Mapping[str, Any], TaskAction, Reply, Deed] | None = None
        self._displaced: Mapping[str, str | None] = {}
        self._taken: dict[str, str] = {}
        self._news: list[str] = []

    def turn(self) -> Turn:
        """Carry out one step if there is one.

        Where the graph was out of reach after the last one, what was done is said first.
        """
        turn = self._take_turn()
        news, self._news = tuple(self._news), []
        return replace(turn, taken=news) if news else turn

    def _take_turn(self) -> Turn:
        if self._acted is not None:
            return self._say(*self._acted)
        claim = self.graph.call("claim_step", lease=_LEASE_S, **self._who())
        self._note_taken(claim)
        if not claim["claimed"]:
            waits = claim["waiting"]
            return Turn("idle", stuck=tuple(sorted({w["plan"] for w in waits if w["stuck"]})))
        action = self.actions.get(claim["action"])
        if action is None:
            return self._end(claim, "failed", f"no program here carries out {claim['action']}")
        item, target = claim["arguments"].get("thing", ""), action.target(claim["arguments"])
        if claim["resumed"] and item and target and self.body.sees(item, target):
            return self._done_before(claim, action, target)
        if not self._may(claim["text"]):
            return self._end(claim, "declined", "a person said no")
        reply = read_reply(claim)
        if reply.does == "end":
            return self._end(claim, reply.result, reply.comment, place=reply.place, lost=reply.lost)
        if reply.does == "look" and item and target and self.body.sees(item, target):
            return self._end(claim, "done", reply.comment, place=target)
        missing = action.missing(self.body, claim["arguments"])
        if missing:
            return self._missed(claim, missing)
        return self._asked(claim, about_acting) or self._act(claim, action, reply)

    def _note_taken(self, claim: Mapping[str, Any]) -> None:
        """Keep what others took over, to be told once; an older server says nothing of it."""
        for step in claim.get("taken", ()):
            if self._taken.get(step["task"]) != step["why"]:
                self._taken[step["task"]] = step["why"]
                self._news.append(f"{step['text']}: {step['why']}")

    def _missed(self, claim: Mapping[str, Any], missing: str) -> Turn:
        """Ask where a thing is that the robot sees nowhere, or end the step."""
        item = claim["arguments"].get("thing", "")
        if item and self.body.find(item) is None:
            asked = self._asked(claim, lambda step: about_place(step, missing, self.graph.query))
            if asked is not None:
                return asked
        return self._failed(claim, missing)

    def _act(self, claim: Mapping[str, Any], action: TaskAction, reply: Reply) -> Turn:
        """Act and report."""
        self._acted = claim, action, reply, action.carry_out(self.body, claim["arguments"])
        # Looked at here, and not where it is told: there the graph may have been away for hours.
        self._displaced = self.body.displaced() if isinstance(self.body, Watching) else {}
        return self._say(*self._acted)

    def _say(self, claim: Mapping[str, Any], action: TaskAction, reply: Reply, deed: Deed) -> Turn:
        """Tell the graph what was done, and forget it, unless the graph is out of reach."""
        try:
            turn = self._tell(claim, action, reply, deed)
        except RemoteUnavailableError:
            raise
        except RtaskError:
            self._acted = None
            raise
        self._acted = None
        return turn

    def _tell(self, claim: Mapping[str, Any], action: TaskAction, reply: Reply, deed: Deed) -> Turn:
        """Report what was done; what a person helped with says nothing about the grasp alone."""
        for item, seen in self._displaced.items():
            self.graph.call("state_place", thing=item, place=seen, lost=seen is None)
        reported = action.is_grasp and reply.does != "try" and self._report(claim, deed)
        if deed.success:
            comment = reply.comment if reply.does == "try" else ""
            place = action.target(claim["arguments"]) or None
            return self._end(claim, "done", comment, place=place, reported=reported)
        return self._failed(claim, deed.reason, reported=reported)

    def _asked(
        self, claim: Mapping[str, Any], question: Callable[[Mapping[str, Any]], dict[str, Any]]
    ) -> Turn | None:
        """Ask a person if the plan has prices for which that is worth it; each thing once."""
        if not claim["asks"]:
            return None
        fields = question(claim)
        if fields["kind"] in claim["asked"]:
            return None
        picture = self.body.picture() if isinstance(self.body, Seeing) else None
        try:
            asked = self.graph.call(
                "ask_person", task=claim["task"], patience=self._patience_s, picture=picture,
                **fields, **self._who(),
            )  # fmt: skip
        except RtaskError as error:
            if error.answer_status != ConflictError.status:
                raise
            return Turn("lost", claim["task"], claim["text"], str(error))
        if not asked["asked"]:
            return None
        return Turn("asked", claim["task"], claim["text"], fields["text"])

    def _done_before(self, claim: Mapping[str, Any], action: TaskAction, target: str) -> Turn:
        """End a step that was done before the robot was started again.

        That a grasp held is not reported now: nobody saw how the thing came to where it is. What
        had been reported before is linked.
        """
        reported = action.is_grasp and bool(self.graph.query(_REPORTED % _report_id(claim["task"])))
        why = "it was done already" + ("" if reported else "; how is not known")
        return self._end(claim, "done", why, place=target, reported=reported)

    def _failed(self, claim: Mapping[str, Any], comment: str, reported: bool = False) -> Turn:
        """End a step that was not done, with where the thing is now."""
        item = claim["arguments"].get("thing", "")
        seen = self.body.find(item) if item else None
        return self._end(
            claim, "failed", comment, place=seen, lost=bool(item) and seen is None,
            reported=reported,
        )  # fmt: skip

    def _end(
        self, claim: Mapping[str, Any], result: str, comment: str, *, place: str | None = None,
        lost: bool = False, reported: bool = False,
    ) -> Turn:  # fmt: skip
        more: dict[str, Any] = {"comment": comment or None, "place": place, "lost": lost}
        if reported:
            more["outcome"] = _report_id(claim["task"])
        try:
            self.graph.call("end_step", task=claim["task"], result=result, **more, **self._who())
        except RtaskError as error:
            if error.answer_status != ConflictError.status:
                raise
            return Turn("lost", claim["task"], claim["text"], str(error))
        return Turn(result, claim["task"], claim["text"], comment)

    def _report(self, claim: Mapping[str, Any], deed: Deed) -> bool:
        """Report the outcome of a grasp of a known product; return whether it is one."""
        item, hand = claim["arguments"]["thing"], claim["arguments"]["hand"]
        rows = self.graph.query(_PRODUCT % item)
        if not rows or hand not in self.body.hands or not deed.was_tried:
            return False
        if deed.attempt is not None:
            self._report_attempt(claim, deed.attempt, str(rows[0]["product"]))
            return True
        width = rows[0]["width"]
        outcome = {
            "success": deed.success,
            "reason": deed.reason,
            "duration_s": deed.duration_s,
            "lifted_m": deed.lifted_m,
            "preset": self.body.physics,
        }
        self.graph.call(
            "report_outcome", task_id=_report_id(claim["task"]), object=str(rows[0]["product"]),
            thing=item, gripper_id=self.body.hands[hand],
            grasp={"id": "", "in_object": _ABOVE, **({} if width is None else {"width": width})},
            outcome={name: value for name, value in outcome.items() if value is not None},
        )  # fmt: skip
        return True

    def _report_attempt(self, claim: Mapping[str, Any], attempt: Attempted, product: str) -> None:
        """Report a grasp as it was; one that the graph does not keep goes with its view."""
        item, hand = claim["arguments"]["thing"], claim["arguments"]["hand"]
        common: dict[str, Any] = {
            "object": product, "thing": item, "gripper_id": self.body.hands[hand], "task": "pick",
            "task_id": _report_id(claim["task"]), "grasp": dict(attempt.grasp),
            "outcome": dict(attempt.outcome),
        }  # fmt: skip
        if "tool_pose" in attempt.grasp and attempt.observation is not None:
            self.graph.call("insert_object", objects=[{**attempt.observation, **common}])
        else:
            self.graph.call("report_outcome", **common)

    def _who(self) -> dict[str, str]:
        return {} if self.robot is None else {"robot": self.robot}


_ABOVE = {"x": 0.0, "y": 0.0, "z": 0.0, "theta": 0.0}
"""A grasp from above at the middle of the thing, in its frame, m and rad."""
_PRODUCT = f"""{PREFIXES}
SELECT ?product (MAX(?w) AS ?width) WHERE {{
  <%s> rt:exemplarOf ?product . ?product rt:objectId ?id OPTIONAL {{ ?product rt:graspWidth ?w }}
}} GROUP BY ?product LIMIT 1"""

_REPORTED = f'{PREFIXES} SELECT ?event WHERE {{ ?event rt:requestId "%s" }} LIMIT 1'


def _report_id(task: str) -> str:
    """Return the id under which the outcome of a step is stored once."""
    return f"step-{hashlib.sha256(task.encode()).hexdigest()[:32]}"
