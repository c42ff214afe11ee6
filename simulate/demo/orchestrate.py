"""The demo from start to end: endpoint, robots one after the other, queries, report."""

from __future__ import annotations

import json
import os
import shutil
import sys
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import rtask
from rtask.errors import RtaskError, UsageError
from simulate.agent.decisions import Thresholds
from simulate.agent.servers import LONG_CALL_S
from simulate.demo.console import Console
from simulate.demo.lessons import lessons_of
from simulate.demo.processes import Endpoint, Robot, RobotJob, run_rtask
from simulate.demo.products import state_kinds
from simulate.demo.queries import QUESTIONS, ask
from simulate.demo.report import (
    COLUMNS,
    NARROW,
    comparison,
    robot_totals,
    rows,
    show_total,
    summary,
    write_report,
)
from simulate.demo.story import gains_of, opening, outcome
from simulate.robots import check_robot
from simulate.world.objects import PRODUCTS

__all__ = ["Demo", "Settings", "objects_on_table", "robots_in_all"]

_MARK = "demo.json"
_SUITABLE = {
    "plain": ("nao",), "light": ("nao", "nao", "panda"), "fragile": ("nao", "nao", "panda"),
    "hard": ("panda",), "unforeseen": ("panda",),
}  # fmt: skip
"""Kinds of robots, in turn. The hard and the unforeseen products are heavy, or break in a strong
hand, which is a Panda's; at the light and the fragile ones, a Panda gets the lessons of two Naos
last."""
_SECONDS_PER_PRODUCT = 8.0
_STORE, _REPORT, _LOGS, _OUTBOX = "store", "report", "logs", "outbox"


def objects_on_table(products: str, asked_for: int | None = None) -> int:
    """Return how many objects lie on each table of a demo.

    No more than four light or fragile ones have room where a Nao reaches both of their ends.
    """
    return asked_for or (4 if products in ("light", "fragile") else 6)


def robots_in_all(products: str, kinds: Sequence[str], asked_for: int | None = None) -> int:
    """Return how many robots a demo has: at least two, and each of the kinds once."""
    return asked_for or max(2, len(kinds or _SUITABLE[products]))


def _command() -> str:
    """Return how to call this program: by its path where a shell does not find its name."""
    if shutil.which("rtask"):
        return "rtask"
    if Path(sys.argv[0]).name == "__main__.py":
        return f"{os.path.relpath(sys.executable)} -m rtask"
    return os.path.relpath(sys.argv[0])


def _new_token(store: Path, *whose: str) -> str:
    made = json.loads(run_rtask("token", "create", "--data", str(store), *whose, "--json"))
    return str(made["token"])


def _ready_sentence(robot: str, event: Mapping[str, Any]) -> str:
    """Return in words what a robot has before it, and whether it works without the graph."""
    number, in_reach = int(event["objects"]), int(event["in_reach"])
    reach = "all in reach" if in_reach == number else f"{in_reach} of them in reach"
    product = "product" if number == 1 else "products"
    twin = robot.removesuffix("-alone")
    table = f", at the table of {twin} but without the graph," if twin != robot else ""
    return f"{robot}{table} faces {number} {product}, {reach}"


@dataclass(frozen=True)
class Settings:
    """Settings of a demo.

    Parameters
    ----------
    data
        Folder for store, report and logs.
    keep
        Continue with the store in ``data`` instead of a new one.
    kinds
        Kinds of the robots, in turn; empty = those that suit the products.
    products
        Set of :data:`simulate.world.objects.PRODUCTS`. On all but the plain ones, the second robot
        and the last also work with a graph of their own, for comparison.
    min_grasp, cautious
        Of :class:`simulate.agent.decisions.Thresholds`.
    details, queries
        Whether to print tables of what each robot did, and SPARQL queries with their answers.
    small_pictures
        Whether pictures are JPEG.
    films
        Whether each attempt that the graph gets is filmed by two cameras.
    """

    data: Path
    seed: int = 0
    objects: int = 6
    robots: int = 2
    max_attempts: int = 4
    keep: bool = False
    gui: bool = False
    port: int = 0
    preset: str = "faithful"
    kinds: tuple[str, ...] = ()
    products: str = "plain"
    min_grasp: float = Thresholds.grasp
    cautious: bool = Thresholds.cautious
    details: bool = False
    queries: bool = False
    small_pictures: bool = False
    films: bool = False

    def __post_init__(self) -> None:
        if not 1 <= self.objects <= 12:
            raise UsageError(f"--objects must lie in 1..12, got {self.objects}")
        if not 1 <= self.robots <= 16:
            raise UsageError(f"--robots must lie in 1..16, got {self.robots}")
        if self.products not in PRODUCTS:
            names = ", ".join(PRODUCTS)
            raise UsageError(f"--products: there is no set {self.products!r}; known: {names}")
        for kind in self.kinds:
            check_robot(kind)
        if self.seed < 0:
            raise UsageError(f"--seed must not be negative, got {self.seed}")

    def kind_of(self, index: int) -> str:
        """Return the kind of a robot by its number."""
        kinds = self.kinds or _SUITABLE[self.products]
        return kinds[index % len(kinds)]

    @property
    def expected_time(self) -> str:
        """How long the robots work on two idle cores, in words; measured with Naos."""
        works = self.robots + len(self.compared)
        minutes = round(works * self.objects * _SECONDS_PER_PRODUCT / 60)
        return f"about {minutes} minutes" if minutes > 1 else "about a minute"

    @property
    def compared(self) -> tuple[int, ...]:
        """Numbers of the robots that also work with a graph of their own: the second, the last."""
        if self.products == "plain" or self.robots < 2:
            return ()
        return tuple(sorted({1, self.robots - 1}))


class Demo:
    """Runs the closed loop once.

    Parameters
    ----------
    settings
        Settings of the demo.
    console
        Receives progress and results.
    """

    def __init__(self, settings: Settings, console: Console) -> None:
        self.settings = settings
        self.console = console
        self._products: dict[str, str] = {}

    def run(self, stay: bool = False) -> dict[str, Any]:
        """Run to the end and return the result that ``--json`` prints.

        Parameters
        ----------
        stay
            Keep the endpoint running until interrupted, so that its pages can be viewed.
        """
        folder = self.settings.data
        self._prepare(folder)
        with ExitStack() as stack:
            endpoint = self._endpoint(folder)
            stack.callback(endpoint.stop)
            for sentence in self._opening():
                self.console.step(sentence)
            self.console.step(f"watch the robots at {endpoint.url}/activity")
            self.console.step(
                f"starting {self.settings.robots} robots; "
                f"they take {self.settings.expected_time} on two idle cores"
            )
            known = set(self._products)
            robots = [self._robot(stack, folder, endpoint.url, i) for i in range(self._count)]
            beside = stack.enter_context(ThreadPoolExecutor(1))
            alone = {
                index: beside.submit(self._watch, self._alone(stack, folder, index), endpoint, {})
                for index in self.settings.compared
            }
            done = [self._watch(robot, endpoint, self._products) for robot in robots]
            apart = {index: work.result() for index, work in alone.items()}
            self._read_labels(folder, endpoint.url, known)
            answers = [ask(endpoint.url, question) for question in QUESTIONS]
            table = rows(done)
            lessons = lessons_of(done)
            result = summary(
                done,
                self.settings.max_attempts,
                folder / _STORE,
                endpoint.url,
                self.settings.seed,
                self.settings.products,
                list(apart.values()),
                [gain.to_dict() for gain in gains_of(done, apart, self.settings.keep)],
                None if lessons is None else lessons.to_dict(),
            )
            write_report(folder / _REPORT, result, table, answers)
            if self.settings.details:
                self.console.table("What the robots did", COLUMNS, table, NARROW)
                self._totals([*done, *apart.values()])
                for index, work in apart.items():
                    self._compare(done[index], work)
            if self.settings.queries:
                for answer in answers:
                    self.console.answer(answer)
            self.console.line(outcome(result))
            if lessons is not None and lessons.won:
                self.console.line(lessons.sentence())
            self._farewell(folder, endpoint.url, stay)
            if stay:
                self._wait(endpoint)
        return result

    def _read_labels(self, folder: Path, url: str, known: set[str]) -> None:
        """State the kinds of the products that the robots met in this run."""
        new = {iri: name for iri, name in self._products.items() if iri not in known}
        if new:
            token = _new_token(folder / _STORE, "--role", "teacher", "--name", "labels")
            with rtask.connect(url, token=token, timeout_s=LONG_CALL_S) as client:
                state_kinds(client, new)

    def _opening(self) -> list[str]:
        names = [self._name(index) for index in range(self._count)]
        alone = [f"{names[index]}-alone" for index in self.settings.compared]
        return opening(self.settings.products, names, alone)

    @property
    def _count(self) -> int:
        return self.settings.robots

    def _prepare(self, folder: Path) -> None:
        """Prepare the folder, which must be new, empty or that of an earlier demo."""
        mark = folder / _MARK
        if folder.exists() and any(folder.iterdir()) and not mark.exists():
            raise UsageError(
                f"{folder} exists and is not a demo's folder; name another with --data"
            )
        if self.settings.keep:
            if not (folder / _STORE).exists():
                raise UsageError(f"--keep: there is no store in {folder}; run once without it")
            self._products = json.loads(mark.read_text(encoding="utf-8"))["products"]
        else:
            for name in (_STORE, _REPORT, _LOGS, _OUTBOX):
                shutil.rmtree(folder / name, ignore_errors=True)
        for name in (_REPORT, _LOGS, _OUTBOX):
            (folder / name).mkdir(parents=True, exist_ok=True)
        self._remember(folder)

    def _remember(self, folder: Path) -> None:
        """Save the settings and, for scoring only, the product behind each object of the store."""
        settings = {**asdict(self.settings), "data": str(folder)}
        text = json.dumps({"settings": settings, "products": self._products}, indent=2)
        (folder / _MARK).write_text(text + "\n", encoding="utf-8")

    def _endpoint(self, folder: Path) -> Endpoint:
        return Endpoint(folder / _STORE, self.settings.port, folder / _LOGS / "endpoint.log")

    def _robot(self, stack: ExitStack, folder: Path, url: str, index: int) -> Robot:
        """Create a token for a robot and start it; it waits for ``go``."""
        name = self._name(index)
        token = _new_token(folder / _STORE, "--robot", name)
        return self._start(stack, folder, self._job(folder, name, url, index), token)

    def _alone(self, stack: ExitStack, folder: Path, index: int) -> Robot:
        """Start a robot once more, at the same table, with a graph of its own."""
        name = f"{self._name(index)}-alone"
        return self._start(stack, folder, self._job(folder, name, "", index), "")

    def _name(self, index: int) -> str:
        return f"{self.settings.kind_of(index)}-{index + 1}"

    def _job(self, folder: Path, name: str, url: str, index: int) -> RobotJob:
        return RobotJob(
            name=name,
            index=index,
            url=url,
            seed=self.settings.seed,
            objects=self.settings.objects,
            max_attempts=self.settings.max_attempts,
            pictures=str(folder / _REPORT / name),
            outbox=str(folder / _OUTBOX / f"{name}.jsonl"),
            gui=self.settings.gui and bool(url),
            preset=self.settings.preset,
            small_pictures=self.settings.small_pictures,
            films=self.settings.films and bool(url),
            robot=self.settings.kind_of(index),
            products=self.settings.products,
            min_grasp=self.settings.min_grasp,
            cautious=self.settings.cautious,
        )

    @staticmethod
    def _start(stack: ExitStack, folder: Path, job: RobotJob, token: str) -> Robot:
        robot = Robot(job.name, asdict(job), token, folder / _LOGS / f"{job.name}.log")
        stack.callback(robot.stop)
        return robot

    def _watch(self, robot: Robot, endpoint: Endpoint, products: dict[str, str]) -> dict[str, Any]:
        """Let one robot clear its table; return its scored encounters.

        Parameters
        ----------
        products
            Product behind each object of the robot's graph, which grows.
        """
        for event in robot.events():
            if event["event"] == "ready":
                self.console.step(_ready_sentence(robot.name, event))
                robot.go()
            elif event["event"] == "done":
                scored = self._score(event, products)
                self._remember(self.settings.data)
                return scored
            elif event["event"] == "waiting" and endpoint.process.poll() is not None:
                raise RtaskError(
                    f"{robot.name} waits for an endpoint that went away "
                    f"({endpoint.complaint()}); what it had to tell is kept in "
                    f"{self.settings.data / _OUTBOX} and goes out with the next run with --keep"
                )
            else:
                self.console.event(robot.name, event)
        raise RtaskError(f"{robot.name} ended without a result")

    @staticmethod
    def _score(done: dict[str, Any], products: dict[str, str]) -> dict[str, Any]:
        """Score the recognitions: an object stands for the product it was first created from.

        A new object is false if its product had one already, or if it stands for no product.
        """
        stored_products = set(products.values())
        done["known_before"] = sum(
            encounter["product"] in stored_products for encounter in done["encounters"]
        )
        for encounter in done["encounters"]:
            if encounter["recognised"]:
                encounter["right"] = (
                    products.get(encounter["recognised"]) == encounter["product"] != ""
                )
            elif encounter["object_iri"] and encounter["object_iri"] not in products:
                encounter["false_object"] = encounter["product"] in {"", *products.values()}
                products[encounter["object_iri"]] = encounter["product"]
        return done

    def _totals(self, done: list[dict[str, Any]]) -> None:
        totals = [robot_totals(robot, self.settings.max_attempts) for robot in done]
        names = [name for name in totals[0] if name != "name"]
        self.console.table(
            "Side by side",
            ("", *(total["name"] for total in totals)),
            [
                (name.replace("_", " "), *(show_total(total[name]) for total in totals))
                for name in names
            ],
        )

    def _compare(self, shared: dict[str, Any], apart: dict[str, Any]) -> None:
        """Print what the graph told the last robot, beside its work without the graph."""
        self.console.table(
            f"{shared['name']}, and the same robot without the graph",
            ("object", "attempts with it", "without", "first grasp from", "told"),
            comparison(shared["encounters"], apart["encounters"]),
        )

    def _farewell(self, folder: Path, url: str, stay: bool) -> None:
        store, rtask = folder / _STORE, _command()
        self.console.line()
        self.console.line(f"report  {folder / _REPORT / 'report.html'}")
        if stay:
            self.console.line(f"pages   {url}/")
        else:
            self.console.line(f"pages   {rtask} serve --data {store} -p 8765")
            url = "http://localhost:8765"
        self.console.line(f"judge   {rtask} token create --data {store} --role teacher --name YOU")
        self.console.line(f"        and sign in with that token at {url}/feedback")
        self.console.line(
            f"more    {rtask} demo --data {folder} --keep --seed {self.settings.seed}"
        )

    def _wait(self, endpoint: Endpoint) -> None:
        self.console.step(f"serving {endpoint.url}/ until Ctrl-C")
        while endpoint.process.poll() is None:
            time.sleep(0.2)  # waiting for Ctrl-C; polling is the only portable way
        raise RtaskError(f"the endpoint went away: {endpoint.complaint()}")
