"""``rtask demo --proof``: one carton of which the audience picks the weak end, and three robots.

A teacher finds out by trial where the carton holds, in the shared graph; another does the same with
another product, in a second graph. Then the same robot meets the carton at the same table three
times: with a graph of its own, with the shared one, and with the second, whose lessons are of
another product. Where the one alone holds at once, because it happens to reach for the firm end,
nothing can be shown: the carton is turned round, or put elsewhere, before any other has met it.

The teacher is withdrawn and the robot works again; the withdrawal is undone and it works once more.
All go through the interfaces that anybody has: processes of robots with tokens, an endpoint, a
SPARQL query, ``withdraw_contributor`` and its undoing. What the robot itself reported is withdrawn
before it works again, so that all it can know comes from its teacher.

Nothing is decided beforehand: what happened is compared with what was to be shown, point by point.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import httpx
import numpy as np

import rtask
from rtask.client import Client
from rtask.errors import RtaskError, UsageError
from simulate.agent.servers import LONG_CALL_S
from simulate.demo.console import Console
from simulate.demo.processes import Endpoint, Robot, RobotJob, run_rtask
from simulate.demo.proof_page import write_proof
from simulate.demo.proof_words import (
    find_evidence,
    first_grasp,
    proof_points,
    proof_rows,
    reliance,
)
from simulate.demo.robot_process import lay_table
from simulate.robots import check_robot
from simulate.world.seeds import stream

__all__ = ["Proof", "ProofSettings", "jobs_at_tables"]

End = Literal["left", "right"]

_MARK = "proof.json"
_PARTS = ("shared", "shuffled", "report", "logs", "outbox")
_DRAWN, _CARTONS = 6, 200
_DRAWS, _TABLES = 60, 4
_TEACHING = 6
"""Attempts of the teachers."""
_ACROSS = 0.7
"""Least sine of the angle between a carton and the line of sight, so that it has a left end."""
_ALONE, _SHARED, _SHUFFLED, _WITHDRAWN, _UNDONE = (
    "alone", "with the graph", "with a shuffled graph", "teacher withdrawn", "withdrawal undone",
)  # fmt: skip
_THREE = (_ALONE, _SHARED, _SHUFFLED)
_ANSWER_S = 30.0


@dataclass(frozen=True)
class ProofSettings:
    """Settings of a proof.

    Parameters
    ----------
    data
        Folder for stores, report and logs.
    weak
        End of the carton that breaks, as the three robots see it.
    seed
        Determines the cartons, tables and choices.
    robot
        Kind of all robots.
    max_attempts
        Attempts of the three robots at the carton; once its teacher is withdrawn, one is enough.
    """

    data: Path
    weak: End
    seed: int = 0
    robot: str = "nao"
    max_attempts: int = 3
    port: int = 0

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise UsageError(f"--seed must not be negative, got {self.seed}")
        if self.max_attempts < 1:
            raise UsageError(f"--attempts must be at least 1, got {self.max_attempts}")
        check_robot(self.robot)

    @property
    def products(self) -> tuple[str, str]:
        """Names of the carton, and of the product of which the shuffled graph knows.

        It is a rod: what one carton teaches is in part true of the next.
        """
        first, second = stream(self.seed, _DRAWN).choice(_CARTONS, 2, replace=False)
        return f"carton-{first}", f"rod-{second}"


def jobs_at_tables(settings: ProofSettings) -> list[RobotJob]:
    """Return the jobs of the robot at some tables: the carton lies across its view, or turned.

    Its weak end is at the wanted side of the first table.

    Raises
    ------
    RtaskError
        The carton lies so on too few of the tables that were tried.
    """
    jobs: list[RobotJob] = []
    mirrored = False
    for index in range(1, _DRAWS):
        job = RobotJob(
            f"{settings.robot}-2", index, "", settings.seed, 1, settings.max_attempts, "", "",
            robot=settings.robot, products="fragile", only=settings.products[0],
            small_pictures=True,
        )  # fmt: skip
        (placed,) = lay_table(job)
        across = float(np.sin(placed.yaw))
        if abs(across) < _ACROSS:
            continue
        if not jobs:
            weak = next(p for p in placed.spec.secret.parts if np.isfinite(p.breaks_at_n))
            is_left = weak.position[0] * across > 0  # +y is the robot's left
            mirrored = is_left != (settings.weak == "left")
        jobs += [replace(job, mirrored=mirrored, turned=turned) for turned in (False, True)]
        if len(jobs) >= _TABLES:
            return jobs
    raise RtaskError(f"{settings.products[0]} lies across the view too rarely; try another seed")


class Proof:
    """Runs the proof once.

    Parameters
    ----------
    settings
        Settings of the proof.
    console
        Receives progress and results.
    """

    def __init__(self, settings: ProofSettings, console: Console) -> None:
        self.settings, self.console = settings, console
        self._jobs = jobs_at_tables(settings)
        self._job = self._jobs[0]
        self._lucky: list[RobotJob] = []
        self._stack = ExitStack()
        self._done: dict[str, dict[str, Any]] = {}

    def run(self, stay: bool = False) -> dict[str, Any]:
        """Run to the end and return the result that ``--json`` prints.

        Parameters
        ----------
        stay
            Keep the endpoint of the shared graph running until interrupted.
        """
        settings, console = self.settings, self.console
        self._prepare()
        console.step(
            f"{settings.products[0]} looks like a plain box; its {settings.weak} end breaks when "
            "it is pressed. No robot is told."
        )
        with self._stack, ThreadPoolExecutor(3) as beside:
            starting = [beside.submit(self._endpoint, part) for part in ("shared", "shuffled")]
            shared, shuffled = (made.result() for made in starting)
            console.step(f"watch the robots at {shared.url}/activity")
            self._teach(beside, shared, shuffled)
            self._meet(beside, shared, shuffled)
            token = self._token("shared", "--role", "admin")
            with rtask.connect(shared.url, token=token, timeout_s=LONG_CALL_S) as admin:
                evidence = self._name_evidence(admin, shared.url)
                withdrawn = self._again_without(admin, shared)
                self._again_with(admin, shared, withdrawn["commit"])
            result = self._result(evidence, withdrawn, shared.url)
            write_proof(settings.data / "report", result)
            self._tell(result)
            if stay:
                console.step("the endpoint keeps running; Ctrl-C ends it")
                shared.process.wait()
                raise RtaskError(f"the endpoint went away: {shared.complaint()}")
        return result

    def _prepare(self) -> None:
        """Prepare the folder, which must be new, empty or that of an earlier proof."""
        folder = self.settings.data
        if folder.exists() and any(folder.iterdir()) and not (folder / _MARK).exists():
            raise UsageError(f"{folder} exists and holds no proof; name another with --data")
        for part in _PARTS:
            shutil.rmtree(folder / part, ignore_errors=True)
        for part in _PARTS[2:]:
            (folder / part).mkdir(parents=True)
        settings = {**asdict(self.settings), "data": str(folder)}
        (folder / _MARK).write_text(json.dumps(settings, indent=1) + "\n", "utf-8")

    def _endpoint(self, part: str) -> Endpoint:
        folder = self.settings.data
        port = self.settings.port if part == "shared" else 0
        endpoint = Endpoint(folder / part, port, folder / "logs" / f"{part}.log")
        self._stack.callback(endpoint.stop)
        return endpoint

    def _token(self, part: str, *whose: str) -> str:
        store = str(self.settings.data / part)
        answer = run_rtask("token", "create", "--data", store, *whose, "--json")
        return str(json.loads(answer)["token"])

    def _find_table(self) -> None:
        """Let the robot alone work at one table after the other until it fails first."""
        for number, job in enumerate(self._jobs, start=1):
            self._job = job
            self._work(_ALONE, job)
            attempt = first_grasp(self._done[_ALONE])
            if attempt is not None and not attempt["held"]:
                return
            if number < len(self._jobs):
                self._lucky.append(job)
                self.console.step(
                    f"alone, {job.name} happened to reach for the firm end at once, which shows "
                    f"nothing; the carton is {'put elsewhere' if job.turned else 'turned round'}"
                )

    def _teach(self, beside: ThreadPoolExecutor, shared: Endpoint, shuffled: Endpoint) -> None:
        """Let a teacher try the carton, and another one another product for the second graph."""
        teacher = f"{self.settings.robot}-1"
        self.console.step(
            f"{teacher} finds out by trial, at a table of its own, and writes what happens into "
            f"the graph; another does so with {self.settings.products[1]} in a second graph; "
            f"{self._job.name} tries alone, with a graph of its own"
        )
        own = {**asdict(self._job), "index": 0, "name": teacher, "max_attempts": _TEACHING}
        other = {**own, "only": self.settings.products[1], "mirrored": False}
        _all(
            beside.submit(self._work, "the teacher", RobotJob(**own), "shared", shared),
            beside.submit(self._work, "the other teacher", RobotJob(**other), "shuffled", shuffled),
            beside.submit(self._find_table),
        )

    def _meet(self, beside: ThreadPoolExecutor, shared: Endpoint, shuffled: Endpoint) -> None:
        self.console.step(
            f"now {self._job.name} meets the carton at the same table with the shared graph, and "
            "with the graph of lessons about another product"
        )
        _all(
            beside.submit(self._work, _SHARED, self._job, "shared", shared),
            beside.submit(self._work, _SHUFFLED, self._job, "shuffled", shuffled),
        )

    def _work(
        self, title: str, job: RobotJob, part: str = "", endpoint: Endpoint | None = None
    ) -> None:
        """Let one robot work in a process of its own, and keep what it did under a title."""
        folder, slug = self.settings.data, title.replace(" ", "-")
        token = self._token(part, "--robot", job.name) if part else ""
        job = RobotJob(
            **asdict(job) | {
                "url": endpoint.url if endpoint else "",
                "pictures": str(folder / "report" / title),
                "outbox": str(folder / "outbox" / f"{slug}.jsonl"),
            }
        )  # fmt: skip
        robot = Robot(title, asdict(job), token, folder / "logs" / f"{slug}.log")
        try:
            for event in robot.events():
                if event["event"] == "ready":
                    robot.go()
                elif event["event"] == "done":
                    self._done[title] = event
                    return
                elif (
                    event["event"] == "waiting" and endpoint and endpoint.process.poll() is not None
                ):
                    raise RtaskError(f"the endpoint went away: {endpoint.complaint()}")
                else:
                    self.console.event(title, event)
        finally:
            robot.stop()
        raise RtaskError(f"{title} ended without a result")

    def _name_evidence(self, admin: Client, url: str) -> list[dict[str, Any]]:
        """Print and return the attempts that the robot with the graph relied on."""
        self._side_by_side(f"{self._job.name} at one table, three times", _THREE)
        attempt = first_grasp(self._done[_SHARED])
        evidence = find_evidence(admin, self._object(_SHARED), self._job.name, attempt)
        for row in evidence:
            row["picture_url"] = f"{url}/api/blobs/{row['picture']}" if row["picture"] else ""
            if row["picture"]:
                picture = httpx.get(row["picture_url"], timeout=_ANSWER_S).raise_for_status()
                row["file"] = f"relied-on-{row['picture'][:12]}.jpg"
                (self.settings.data / "report" / row["file"]).write_bytes(picture.content)
        self.console.line(reliance(attempt, evidence))
        return evidence

    def _object(self, title: str) -> str:
        return next((m["object_iri"] for m in self._done[title]["encounters"]), "")

    def _again_without(self, admin: Client, shared: Endpoint) -> dict[str, Any]:
        """Withdraw what the robot told, then its teacher, and let it work again."""
        teacher = f"{self.settings.robot}-1"
        self._forget_own(admin)
        done = dict(admin.withdraw_contributor(contributor=teacher))
        self.console.step(
            f"{teacher} is withdrawn: commit {done['commit']}, {done['attempts']} attempts and "
            f"{done['removed']} statements; {self._job.name} meets the carton again"
        )
        self._work(_WITHDRAWN, replace(self._job, max_attempts=1), "shared", shared)
        return done

    def _again_with(self, admin: Client, shared: Endpoint, commit: str) -> None:
        """Undo the withdrawal and let the robot work once more."""
        self._forget_own(admin)
        undone = admin.curate_object(operation="undo", commit=commit)
        self.console.step(
            f"the withdrawal is undone by {undone['commit']}; {self._job.name} meets it once more"
        )
        self._work(_UNDONE, replace(self._job, max_attempts=1), "shared", shared)

    def _forget_own(self, admin: Client) -> None:
        """Withdraw what the robot itself reported: it is to know only what others told it."""
        admin.withdraw_contributor(contributor=self._job.name)

    def _result(
        self, evidence: list[dict[str, Any]], withdrawn: Mapping[str, Any], url: str
    ) -> dict[str, Any]:
        order = (*_THREE, _WITHDRAWN, _UNDONE)
        points = proof_points(self._done, order, evidence)
        carton, other = self.settings.products
        return {
            "carton": carton, "weak": self.settings.weak, "lessons_of_another": other,
            "robot": self._job.name, "teacher": f"{self.settings.robot}-1",
            "seed": self.settings.seed, "url": url,
            "runs": {title: self._done[title]["encounters"] for title in (
                "the teacher", "the other teacher", *order)},
            "relied_on": evidence,
            "tables_alone_held_at_once": len(self._lucky),
            "turned": self._job.turned,
            "withdrawn": dict(withdrawn),
            "points": points,
            "shown": all(point["shown"] for point in points),
        }  # fmt: skip

    def _tell(self, result: Mapping[str, Any]) -> None:
        """Print what was to be shown, and whether it was."""
        self._side_by_side(
            f"{self._job.name}, its teacher withdrawn and back", (_SHARED, _WITHDRAWN, _UNDONE)
        )
        for point in result["points"]:
            self.console.line(f"{'yes' if point['shown'] else 'NO '}  {point['text']}")
        if not result["shown"]:
            self.console.line(
                "Physics decided otherwise here than was to be shown; the lines with NO say where."
            )
        self.console.line(f"report  {self.settings.data / 'report' / 'proof.html'}")
        self.console.line(f"pages   rtask serve --data {self.settings.data / 'shared'} -p 8765")

    def _side_by_side(self, title: str, runs: tuple[str, ...]) -> None:
        self.console.table(title, ("attempt", *runs), proof_rows(self._done, runs))


def _all(*works: Future[None]) -> None:
    """Wait for all; raise the first error."""
    for work in works:
        work.result()
