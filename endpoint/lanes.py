"""Where the work of a request is done, and the way of a query from one place to the next.

A query takes one step after another until it is answered; each arrow is one method here::

    planned --+-- is cached, or not modified, or looked up in memory --> loop ----> answered
              |
              +-- looks quick --> pipe --+-- its answer came as a whole ----------> answered
              |   (plan.lane point)      |
              |                          +-- no reader is free --+-- look-up -----> answered
              |                          |                       |
              |                          +-- long answer ------> thread ----------> answered
              |                          |                       |
              |                          +-- takes longer ----+  +-- takes longer --+
              |                                               v                     |
              +-- looks long --------------------------------> long <---------------+
                                                                 |
                                                                 +----------------> answered

``loop`` is the server's event loop, at once. ``pipe`` is a reader process that the event loop asks
and whose answer it awaits (:mod:`endpoint.point_lines`). ``thread`` waits for a reader reserved for
quick queries, or for the rest of an answer; ``long`` waits for one of the few other readers. Under
a WSGI server there is no pipe: what looks quick begins in ``thread``. All other work has threads of
its own, so that neither writes nor health checks ever wait behind queries.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from time import perf_counter

from endpoint.access.auth import Caller
from endpoint.fair_pool import FairPool
from endpoint.http.messages import Request, Response
from endpoint.http.plan import Elsewhere, Plan
from endpoint.point_lines import Instead
from endpoint.sparql.answers import SlowerThanItLooksError
from rtask.errors import RtaskError
from rtask.kb.readers.line import Answer
from rtask.kb.readers.streams import ReaderStream

__all__ = ["Job", "Lanes"]

THREADS = 32
SHARE = 8
"""Threads that the requests of one token have at most; the rest of them wait for each other."""
POINT_THREADS = 8


@dataclass
class Job:
    """A request in progress.

    Parameters
    ----------
    request
        The request as received.
    plan
        The work to do.
    caller
        Who sent it; none if not yet, or not to be, identified.
    leave
        Called when the request has ended.
    version
        Of the graph when the request came.
    """

    request: Request
    plan: Plan
    caller: Caller | None = None
    leave: list[Callable[[], None]] = field(default_factory=list)
    started: float = field(default_factory=perf_counter)
    version: str = ""


class Lanes:
    """Threads for the work of requests; moves a query on that needs another place.

    Parameters
    ----------
    max_queries
        Long queries at once.
    run
        Does the work of a request; errors but :class:`SlowerThanItLooksError` are answers.
    refuse
        Returns the answer to a request whose work could not be started.
    """

    def __init__(
        self,
        max_queries: int,
        run: Callable[[Job], Response],
        refuse: Callable[[RtaskError, Job], Response],
    ) -> None:
        self._run, self._refuse = run, refuse
        self._work = FairPool(THREADS, SHARE, "work")
        self._long = FairPool(max_queries, max(1, max_queries // 4), "query")
        self._quick = ThreadPoolExecutor(POINT_THREADS, thread_name_prefix="point")

    def payload(self, job: Job) -> bytes | None:
        """Return a query as it is sent to a reader's pipe; None if a thread is to do the work."""
        query = job.plan.query
        if query is None or job.plan.lane != "point":
            return None
        try:
            return query.encode()
        except RtaskError:
            # The thread meets the error again, and answers it.
            return None  # the thread meets it again and answers it

    def after_pipe(self, job: Job, outcome: Answer | ReaderStream | Instead) -> Response | None:
        """Return the answer to a query that was asked at a pipe; does not wait.

        Returns
        -------
        None if it is to be submitted to a thread, together with the stream if that is the outcome.
        """
        query = job.plan.query
        assert query is not None
        if isinstance(outcome, Answer):
            job.plan.run = partial(query.whole, outcome)
            return self._run(job)
        if outcome is Instead.ASK_AMONG_LONG:
            self._demote(job)
        elif outcome is Instead.ASK_IN_THREAD:
            response = query.look_up()
            if response is not None:
                job.plan.run = lambda: response
                return self._run(job)
        return None

    def submit(self, job: Job, stream: ReaderStream | None = None) -> Future[Response]:
        """Start the work of a request on the threads of its lane.

        Parameters
        ----------
        stream
            A long answer that has begun to arrive at a pipe.
        """
        plan = job.plan
        if stream is not None:
            assert plan.query is not None
            plan.run = partial(plan.query.resume, stream)
        if plan.elsewhere is not None:
            # Its threads are its own: to wait for it here would hold up one of ours.
            return self._submit_elsewhere(job, plan.elsewhere)
        if plan.lane == "point":
            return self._submit_quick(job)
        lane = self._long if plan.lane == "query" else self._work
        return lane.submit(_key(job), partial(self._run, job))

    def _submit_elsewhere(self, job: Job, elsewhere: Elsewhere) -> Future[Response]:
        """Start work that threads of its own do; the one that ends it makes the answer."""
        answer: Future[Response] = Future()
        try:
            work = elsewhere.start()
        except RtaskError as error:
            answer.set_result(self._refuse(error, job))
        else:
            work.add_done_callback(lambda _: answer.set_result(self._run(job)))
        return answer

    def _submit_quick(self, job: Job) -> Future[Response]:
        """Start a query that looks quick; if it is not, continue it among the long ones."""
        answer: Future[Response] = Future()

        def first() -> None:
            if not answer.set_running_or_notify_cancel():
                return
            try:
                answer.set_result(self._run(job))
            except SlowerThanItLooksError:
                self._demote(job)
                # The same future goes on, so that nobody who waits for it has to know.
                self._long.submit(_key(job), second)
            except BaseException as error:  # noqa: BLE001 - the future carries it
                answer.set_exception(error)

        def second() -> None:
            try:
                answer.set_result(self._run(job))
            except BaseException as error:  # noqa: BLE001 - the future carries it
                answer.set_exception(error)

        self._quick.submit(first)
        return answer

    @property
    def work(self) -> ThreadPoolExecutor:
        """The threads for work of nobody in particular."""
        return self._work.threads

    @staticmethod
    def _demote(job: Job) -> None:
        """Move a query that took longer than it looked among the long ones."""
        assert job.plan.query is not None
        job.plan.run, job.plan.lane = job.plan.query.run, "query"

    def close(self, *, wait: bool) -> None:
        """Accept no more work; wait for the work in progress if asked to."""
        for pool in (self._long, self._work):
            pool.shutdown(wait=wait)
        self._quick.shutdown(wait=wait, cancel_futures=True)


def _key(job: Job) -> str | None:
    """Return who has a share of the threads; nobody without a token, whom nothing tells apart."""
    caller = job.caller
    return None if caller is None or caller.token is None else caller.token.id
