"""The host of services: finds them, binds their data, queues their calls, and keeps their jobs."""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

from rtask.engine.context import SCOPES
from rtask.errors import (
    ClosedError,
    ForbiddenError,
    MissingDataError,
    MissingExtraError,
    RtaskError,
    UnknownTermError,
    UsageError,
    nearest,
)
from rtask.extras import missing_libraries, needs_extra
from rtask.kb.commit.access import Access
from rtask.services.call import Call, Invocation
from rtask.services.datasets.store import Datasets
from rtask.services.definition import Definition, Method, define
from rtask.services.description import described, listed
from rtask.services.executors.in_process import InProcess
from rtask.services.executors.processes import ChildProcess
from rtask.services.executors.setup import InstanceSetup, Written
from rtask.services.jobs import Job, Jobs
from rtask.services.outward.connected import Connected
from rtask.services.outward.seats import Outward
from rtask.services.pool import Pool, Runner, Sizes, load_of
from rtask.services.proxy import Proxy, offer_of
from rtask.services.registry import Registry
from rtask.services.resources import Files, GraphResource, Resource, WritableFiles
from rtask.services.service import Service
from rtask.services.task import Mapped, Task
from rtask.wire.dataset_words import with_example
from rtask.wire.effect import strongest
from rtask.wire.message import Answer, read

if TYPE_CHECKING:
    from rtask.kb.core import GraphCore
    from rtask.services.executors.ray_actors import RayActor

__all__ = ["ServiceHost"]

MAX_TIMEOUT_S = 600.0
MAX_JOB_S = 3600.0
MAX_POOLS = 32
CHECK_S = 120.0
CHECKED_AT_ONCE = 4


class ServiceHost:
    """Carries out calls of services.

    Parameters
    ----------
    services
        Classes or definitions to offer.
    kb
        The knowledge graph for services that need it; None = there is none.
    datasets
        The datasets for data resources; None = there are none.
    check_every
        How many calls there are to one whose effect on the state is checked; 1 = all. Default: the
        environment variable RTASK_CHECK_STATE, else 100.

    Attributes
    ----------
    registry
        What is offered.
    jobs
        Calls that callers come back to.
    datasets
        Its datasets.
    outward
        The workers that connected from other machines.
    """

    def __init__(
        self,
        services: Iterable[type[Service] | Definition] = (),
        kb: GraphCore | None = None,
        datasets: Datasets | None = None,
        check_every: int | None = None,
    ) -> None:
        self.registry = Registry()
        self.jobs = Jobs()
        self.outward = Outward(self.registry, self._resize)
        self._kb = kb
        self.datasets = datasets or Datasets(None)
        self._check_every = check_every or int(os.environ.get("RTASK_CHECK_STATE", "100"))
        self._lock = threading.Lock()
        self._pools: dict[tuple[str, Mapped], Pool] = {}
        self._closing: list[threading.Thread] = []
        self._dropped = 0
        self._closed = False
        for service in services:
            self.registry.add(service if isinstance(service, Definition) else define(service))

    def call(
        self,
        service: str,
        method: str,
        args: Mapping[str, Any] | None = None,
        access: Access | None = None,
        data: Mapping[str, str] | None = None,
        timeout_s: float | None = None,
    ) -> Answer:
        """Call a method and wait for its answer.

        Parameters
        ----------
        service
            ``example/Kinematics``, or with a version: ``@1.2.0``, ``@1.2.*``, ``@1.*``.
        args
            The request.
        access
            Rights of the caller; None = those of the owner.
        data
            Names of datasets by the names of the data resources.
        timeout_s
            Time for the answer; None = as the service says.

        Raises
        ------
        UnknownTermError
            No such service or method.
        UsageError
            The request does not fit.
        ServiceError
            One of its kinds says what went wrong in the service.
        """
        asked = Invocation(service, method, args or {}, access, data, timeout_s)
        return self.submit(asked).result()

    def submit(self, asked: Invocation) -> Task:
        """Queue a call and return at once; errors as :meth:`call`."""
        task = self.prepare(asked)
        self.start(task)
        return task

    def prepare(self, asked: Invocation) -> Task:
        """Check a call and return it, to be started later; errors as :meth:`call`."""
        definition, entry = self.find(asked.service, asked.method)
        access, parent = asked.access or Access(), asked.parent
        if entry.scope not in SCOPES[access.role]:
            raise ForbiddenError(f"needs scope {entry.scope}; the role {access.role} lacks it")
        request = read(entry.request, dict(asked.args))
        mapped = self._mapped(definition, asked.data or {}, access, asked.data_form)
        asked_s = asked.timeout_s
        seconds = definition.timeout_s if asked_s is None else min(asked_s, MAX_JOB_S)
        chain = (*parent.chain, definition.name) if parent else (definition.name,)
        if parent is not None:
            seconds = min(seconds, parent.left_s)
            if definition.name in parent.chain:
                raise UsageError(f"a circle of calls: {' -> '.join(chain)}")
            if strongest(entry.effect, parent.effect) != parent.effect:
                raise UsageError(
                    f"{definition.exact} {entry.effect} by its method {entry.name}, but is called "
                    f"by a method that declares effect={parent.effect!r}"
                )
        call = Call(access, seconds, chain, self, entry.effect)
        may_repeat = entry.effect != "writes"
        task = Task(entry, request, call, definition.exact, mapped, may_repeat=may_repeat)
        if parent is not None:
            parent.on_cancel(task.cancel)
        return task

    def start(self, task: Task) -> None:
        """Queue a call that was prepared."""
        definition = self.registry.find(task.service)
        try:
            self._pool(definition, task.data).submit(task)
        except ClosedError:
            if self._closed:
                raise
            self._pool(definition, task.data).submit(task)  # the queue was just retired

    def start_job(self, task: Task, owner: str) -> Job:
        """Queue a call that was prepared, and keep it for its caller to come back to.

        Parameters
        ----------
        owner
            Key of the caller.
        """
        job = self.jobs.add(task, owner)
        try:
            self.start(task)
        except RtaskError:
            self.jobs.forget(job)
            raise
        return job

    def find(self, service: str, method: str) -> tuple[Definition, Method]:
        """Return the definitions of a service and of one of its methods.

        Raises
        ------
        UnknownTermError
            Either does not exist; the nearest name is named.
        """
        definition = self.registry.find(service)
        declared = definition.methods.get(method)
        if declared is None:
            hint = nearest(method, list(definition.methods))
            raise UnknownTermError(f"{definition.exact} has no method {method!r}{hint}")
        return definition, declared

    def connect(
        self,
        service: str,
        data: Mapping[str, str] | None = None,
        access: Access | None = None,
    ) -> Proxy:
        """Return an object with the methods of a service."""
        definition = self.registry.find(service)
        return self._proxy(definition, data, access)

    def listing(self) -> list[dict[str, Any]]:
        """Return the services that are offered, as JSON."""
        versions = self.registry.versions
        return [
            listed(
                definition,
                versions(definition.name),
                self.state(definition),
                self.problem(definition),
            )
            for definition in self.registry
        ]

    def description(self, service: str) -> dict[str, Any]:
        """Return the description of a service, as JSON.

        Raises
        ------
        UnknownTermError
            No such service.
        """
        definition = self.registry.find(service)
        versions = self.registry.versions(definition.name)
        said = described(definition, versions, self.state(definition), self.problem(definition))
        return {**said, "calls": load_of(self._pools_of(definition))}

    def state(self, definition: Definition) -> str:
        """Return the state of a service.

        Returns
        -------
        ``ready``, ``failed`` where it could not be made ready, ``untried`` where it has not been
        started yet, or ``waiting`` where only workers have it and none is connected.
        """
        if _lacking_extra(definition) is not None:
            return "failed"
        if definition.executor == "outward":
            return "ready" if self.outward.count(definition.exact) else "waiting"
        states = {pool.state for pool in self._pools_of(definition)}
        return next((state for state in ("failed", "ready") if state in states), "untried")

    def problem(self, definition: Definition) -> RtaskError | None:
        """Return why a service cannot be used: an extra is missing, or its last start failed."""
        failures = (pool.problem for pool in self._pools_of(definition))
        return _lacking_extra(definition) or next(
            (failure for failure in failures if failure), None
        )

    def _pools_of(self, definition: Definition) -> list[Pool]:
        with self._lock:
            return [p for (exact, _), p in self._pools.items() if exact == definition.exact]

    def check(self, timeout_s: float = CHECK_S) -> list[RtaskError]:
        """Start a worker of each service whose data are known, and return what went wrong.

        Services whose callers name the data, and those of connected workers, are left out.
        """
        pools = []
        for definition in self.registry:
            if definition.executor != "outward":
                with contextlib.suppress(MissingDataError):
                    pools.append(
                        (definition, self._pool(definition, self._mapped(definition, {}, Access())))
                    )
        until = time.monotonic() + timeout_s
        # Some services load for a minute: one after the other would take as long as all together.
        with ThreadPoolExecutor(CHECKED_AT_ONCE) as threads:
            for _, pool in pools:
                threads.submit(lambda pool: pool.try_start(until - time.monotonic()), pool)
        problems = (self.problem(definition) for definition, _ in pools)
        return [problem for problem in problems if problem is not None]

    def close(self) -> None:
        """Wait for running calls to end, then shut all services down at the same time."""
        self.jobs.close()
        with self._lock:
            self._closed = True
            pools, self._pools = list(self._pools.values()), {}
            closing = [*self._closing, *_close_in_threads(pools)]
        for thread in closing:
            thread.join()
        self.datasets.close()

    def __enter__(self) -> ServiceHost:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def connect_within(
        self, parent: Call, service: str, data: Mapping[str, str] | None = None
    ) -> Proxy:
        """Return an object with the methods of a service, called on behalf of another call."""
        return self._proxy(self.registry.find(service), data, parent.caller, parent)

    def _proxy(
        self,
        definition: Definition,
        data: Mapping[str, str] | None,
        access: Access | None,
        parent: Call | None = None,
    ) -> Proxy:
        def carry_out(method: str, args: dict[str, Any]) -> Answer:
            asked = Invocation(definition.exact, method, args, access, data, None, parent)
            return self.submit(asked).result()

        offers = [offer_of(declared_method) for declared_method in definition.methods.values()]
        return Proxy(definition.exact, offers, carry_out)

    def check_data(
        self, service: str, data: Mapping[str, str], access: Access, form: str = "data="
    ) -> None:
        """Refuse a call whose data resources are missing, before it is made.

        Raises
        ------
        MissingDataError, UsageError
        """
        self._mapped(self.registry.find(service), data, access, form)

    def _mapped(
        self, definition: Definition, data: Mapping[str, str], access: Access, form: str = "data="
    ) -> Mapped:
        """Return the exact version of the dataset for each data resource that takes one.

        Raises
        ------
        UsageError
            A data resource that the service does not have.
        MissingDataError
            One without a dataset.
        """
        if not isinstance(data, Mapping) or not all(isinstance(d, str) for d in data.values()):
            raise UsageError("data resources: expected names of datasets by names of resources")
        mapped = {
            n: declared_need
            for n, declared_need in definition.resources.items()
            if declared_need.type != "graph"
        }
        for name in data:
            if name not in mapped:
                hint = nearest(name, list(mapped)) or f"; it has {', '.join(mapped) or 'none'}"
                raise UsageError(f"{definition.exact} has no data resource {name!r}{hint}")
        for name, need in mapped.items():
            if name not in data and need.default is None:
                words = f"{definition.exact} needs a dataset for {name!r}"
                raise MissingDataError(with_example(words, name, form), resource=name)
        bound = []
        for name, need in sorted(mapped.items()):
            try:
                version = self.datasets.find(data.get(name) or str(need.default), access)
            except UnknownTermError as error:
                raise MissingDataError(f"{name}: {error}", resource=name) from None
            if need.writable:  # on the head, and sees what others store there
                bound.append((name, f"{version.dataset}@head", ""))
            else:
                # The head has no number of its own; its contents tell one state from another.
                bound.append((name, version.name, version.digest))
        if self._kb is None and len(mapped) < len(definition.resources):
            raise MissingDataError(f"{definition.exact} needs a graph, and there is none here")
        return tuple(bound)

    def _resources(self, definition: Definition, mapped: Mapped) -> dict[str, Resource]:
        bound: dict[str, Resource] = {}
        for name, dataset, _ in mapped:
            kind = WritableFiles if definition.resources[name].writable else Files
            folder = self.datasets.view(self.datasets.find(dataset))
            bound[name] = files = kind(dataset, folder)
            self.datasets.keep_view(folder, files)
        for name, need in definition.resources.items():
            if need.type == "graph" and self._kb is not None:
                bound[name] = GraphResource(self._kb, need.writable)
        return bound

    def _retire(self) -> None:
        """Close the queues without work when there are many: each state of a head has its own."""
        if len(self._pools) < MAX_POOLS:
            return
        with self._lock:
            idle = [key for key, pool in self._pools.items() if pool.is_idle]
            retired = [self._pools.pop(key) for key in idle]
            still = [thread for thread in self._closing if thread.is_alive()]
            # Shut-down methods take their time, and the caller may be the server's event loop.
            self._closing = [*still, *_close_in_threads(retired)]

    def _pool(self, definition: Definition, mapped: Mapped) -> Pool:
        key = (definition.exact, mapped)
        self._retire()
        with self._lock:
            if self._closed:
                raise ClosedError("the services are being shut down")
            pool = self._pools.get(key)
            if pool is None:
                names = {name: dataset.partition("@")[0] for name, dataset, _ in mapped}

                def commit(written: Written, access: Access) -> None:
                    self.datasets.put_together(
                        {names[name]: files for name, files in written.items() if files}, access
                    )

                def heads() -> list[str]:
                    # Of what is only read, the version stays as it is.
                    written_to = [dataset for _, dataset, digest in mapped if not digest]
                    return [self.datasets.find(path).digest for path in written_to]

                def start() -> Runner:
                    seat = self.outward.seat(definition)
                    if seat is not None:
                        return Connected(self.outward, seat)
                    bound = heads()  # before they are bound, so that no write is overlooked
                    resources = self._resources(definition, mapped)
                    every = self._check_every
                    setup = InstanceSetup(definition, resources, every, lambda: heads() != bound)
                    return _runner_kind(definition)(setup)

                sizes = Sizes(self._workers(definition), definition.max_waiting)
                pool = self._pools[key] = Pool(
                    definition.exact, start, sizes, commit, self._count_dropped
                )
        return pool

    def _count_dropped(self) -> None:
        with self._lock:
            self._dropped += 1

    @property
    def dropped(self) -> int:
        """Number of calls that were carried out after their ends: nothing of them was stored."""
        return self._dropped + self.outward.dropped

    def _workers(self, definition: Definition) -> int:
        """Return how many workers a queue of a service may have, here and on other machines."""
        # Two writers of one head would overwrite each other.
        if definition.is_writing:
            return 1
        here = definition.max_workers or os.cpu_count() or 1
        if definition.executor == "outward":
            here = 0
        return max(here + self.outward.count(definition.exact), 1)

    def _resize(self, exact: str) -> None:
        """Adapt the queues of a service to the workers that are connected."""
        definition = self.registry.exact(exact)
        with self._lock:
            pools = [pool for (name, _), pool in self._pools.items() if name == exact]
        if definition is not None:
            for pool in pools:
                pool.resize(self._workers(definition))


def _runner_kind(definition: Definition) -> type[InProcess | ChildProcess | RayActor]:
    """Return the class of what carries out the calls of a service in or near this process."""
    if definition.executor == "ray":
        from rtask.services.executors.ray_actors import RayActor

        return RayActor
    return ChildProcess if definition.executor == "processes" else InProcess


def _close_in_threads(pools: Iterable[Pool]) -> list[threading.Thread]:
    """Close each queue in a thread of its own, and return the threads."""
    threads = [threading.Thread(target=pool.close, daemon=True) for pool in pools]
    for thread in threads:
        thread.start()
    return threads


def _lacking_extra(definition: Definition) -> MissingExtraError | None:
    """Return the error that names the extra of a service, where its libraries are missing."""
    if not definition.extra or not missing_libraries(definition.extra):
        return None
    return needs_extra(definition.extra, definition.name)
