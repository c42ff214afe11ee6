"""The interface for programs, independent of any server: one request in, one response out.

Flask and the ASGI application both pass the requests of programs to :class:`Application`. Pages for
people belong to Flask alone.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial

from endpoint.access.auth import Caller, cors_headers
from endpoint.context import ServerContext
from endpoint.follow.versions import minimum_version, staleness_headers
from endpoint.http.compression import compressed, unpacked
from endpoint.http.messages import Request, Response, require_method
from endpoint.http.plan import Elsewhere, Plan
from endpoint.http.problems import problem, slug_of
from endpoint.point_lines import Instead
from endpoint.router import Router
from endpoint.routes import find
from endpoint.sparql import protocol
from endpoint.sparql.answers import SlowerThanItLooksError
from rtask.errors import AccessError, RtaskError, TooLargeError
from rtask.kb.readers.line import Answer
from rtask.kb.readers.streams import ReaderStream
from rtask.knowledge_base import KnowledgeBase

THREADS = 32
POINT_THREADS = 8
MAX_WHOLE_BYTES = 64 << 20


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
    started: float = field(default_factory=time.perf_counter)
    version: str = ""


class Application:
    """Answers the requests of programs.

    Parameters
    ----------
    context
        The parts of the server; :meth:`close` closes them.
    """

    def __init__(self, context: ServerContext) -> None:
        self.context = context
        self.router = Router(context)
        # Long work has threads of its own, so that neither writes nor health checks ever wait
        # behind queries.
        self.pool = ThreadPoolExecutor(THREADS, thread_name_prefix="work")
        self.query_pool = ThreadPoolExecutor(context.config.max_queries, thread_name_prefix="query")
        self.point_pool = ThreadPoolExecutor(POINT_THREADS, thread_name_prefix="point")
        self._starting: Future[None] | None = None
        self._stop_listening = context.kb.on_commit(context.request_log.commit)

    def handle(self, request: Request) -> Response:
        """Answer a request in the calling thread, abandoning queries at their time limit."""
        job = self.admit(request)
        try:
            if job.plan.timeout_s is None:
                response = self.run(job)
            else:
                work = self.submit(job)
                try:
                    response = work.result(job.plan.timeout_s)
                except TimeoutError:
                    refusal = self.give_up(work, job)
                    response = work.result() if refusal is None else refusal
        except BaseException:
            self.end(job)
            raise
        if response.chunks is not None:
            response = self._read_whole(job, response)
        self.end(job)
        self.report(job, response, len(response.body))
        return response

    def _read_whole(self, job: Job, response: Response) -> Response:
        """Read an answer to its end: a WSGI server does not tell when it sent the last piece."""
        assert response.chunks is not None
        pieces, size = [response.body], len(response.body)
        try:
            for piece in response.chunks:
                pieces.append(piece)
                size += len(piece)
                if size > MAX_WHOLE_BYTES:
                    raise TooLargeError(
                        f"the answer exceeds {MAX_WHOLE_BYTES} bytes; add a LIMIT",
                        limit=MAX_WHOLE_BYTES,
                    )
        except RtaskError as error:
            return self._finish(self._problem(error, job), job)
        finally:
            response.chunks.close()
        return replace(response, body=b"".join(pieces), chunks=None)

    def admit(self, request: Request) -> Job:
        """Parse and authorise a request; never raises, for errors are answers too."""
        job = Job(request, Plan.ready(Response()), version=self.context.versions.current())
        try:
            self._route(job)
        except Exception as error:  # noqa: BLE001 - every error is an answer
            job.plan = Plan.ready(self._problem(error, job))
        return job

    def refused(self, error: Exception, request: Request) -> Job:
        """Return the job of a request that was refused before its body was read."""
        job = Job(request, Plan.ready(Response()))
        job.plan = Plan.ready(self._problem(error, job))
        return job

    def encoded(self, job: Job) -> bytes | None:
        """Return a point query as it is sent to a reader; none if a thread is to do the work."""
        if job.plan.encode is None or job.plan.lane != "point":
            return None
        try:
            return job.plan.encode()
        except RtaskError:
            return None  # the thread meets it again and answers it

    def start_reader(self) -> None:
        """Start a reader in the background, if none is being started yet."""
        readers = self.context.kb.readers
        if not readers.possible or (self._starting is not None and not self._starting.done()):
            return
        self._starting = self.pool.submit(readers.start, False)

    def arrived(self, job: Job, outcome: Answer | ReaderStream | Instead) -> Response | None:
        """Return the response to a point query that was asked on the event loop; does not wait.

        Returns
        -------
        None if it is to be submitted to a thread, together with the stream if that was found.
        """
        if isinstance(outcome, Answer):
            assert job.plan.whole is not None
            job.plan.run = partial(job.plan.whole, outcome)
            return self.run(job)
        if outcome is Instead.ASK_AMONG_LONG:
            self.demote(job)
        elif outcome is Instead.ASK_IN_THREAD:
            return self._look_up(job)
        return None

    def _look_up(self, job: Job) -> Response | None:
        """Answer a look-up at once from the store; none if it is not one, or not a small one."""
        response = job.plan.look_up() if job.plan.look_up else None
        if response is None:
            return None
        job.plan.run = lambda: response
        return self.run(job)

    def submit(self, job: Job, stream: ReaderStream | None = None) -> Future[Response]:
        """Start the work of a request on the thread pool of its lane.

        Parameters
        ----------
        stream
            A long answer that has begun to arrive.
        """
        if stream is not None:
            assert job.plan.resume is not None
            job.plan.run = partial(job.plan.resume, stream)
        if job.plan.elsewhere is not None:
            return self._submit_elsewhere(job, job.plan.elsewhere)
        if job.plan.lane == "point":
            return self._submit_point(job)
        pool = self.query_pool if job.plan.lane == "query" else self.pool
        return pool.submit(self.run, job)

    def _submit_elsewhere(self, job: Job, elsewhere: Elsewhere) -> Future[Response]:
        """Start work that threads of its own do; the one that ends it makes the answer."""
        answer: Future[Response] = Future()
        try:
            work = elsewhere.start()
        except RtaskError as error:
            answer.set_result(self._finish(self._problem(error, job), job))
        else:
            work.add_done_callback(lambda _: answer.set_result(self.run(job)))
        return answer

    def _submit_point(self, job: Job) -> Future[Response]:
        """Start a query that looks quick; if it is not, continue it among the long ones."""
        answer: Future[Response] = Future()

        def first() -> None:
            if not answer.set_running_or_notify_cancel():
                return
            try:
                answer.set_result(self.run(job))
            except SlowerThanItLooksError:
                self.demote(job)
                self.query_pool.submit(second)
            except BaseException as error:  # noqa: BLE001 - the future carries it
                answer.set_exception(error)

        def second() -> None:
            try:
                answer.set_result(self.run(job))
            except BaseException as error:  # noqa: BLE001 - the future carries it
                answer.set_exception(error)

        self.point_pool.submit(first)
        return answer

    @staticmethod
    def demote(job: Job) -> None:
        """Plan a query that took longer than it looked among the long ones."""
        assert job.plan.again is not None
        job.plan.run, job.plan.lane, job.plan.again = job.plan.again, "query", None

    def run(self, job: Job) -> Response:
        """Do the work of a request; errors become answers."""
        try:
            response = job.plan.run()
        except SlowerThanItLooksError:
            raise
        except Exception as error:  # noqa: BLE001 - every error is an answer
            response = self._problem(error, job)
        response = compressed(response, job.request)
        if job.plan.keep is not None:
            job.plan.keep(response)
        return self._finish(response, job)

    def give_up(self, work: Future[Response], job: Job) -> Response | None:
        """Answer for work that exceeded its time limit; None if the work itself answers now."""
        elsewhere = job.plan.elsewhere
        if elsewhere is not None:
            if elsewhere.late is None:
                elsewhere.stop()
                return self.run(job)
            elsewhere.late()
            return None
        self.context.queries.abandon(work)
        self.context.metrics.count("rtask_query_aborted_total", reason="timeout")
        config, running = self.context.config, job.plan.running
        seconds = job.plan.timeout_s
        if running is not None:
            running.stop()
            seconds = running.timeout_s
        refusal = protocol.timed_out(seconds or config.timeout_s, config)
        return self._finish(problem(refusal, job.request.id), job)

    def end(self, job: Job) -> None:
        """Release what a request held; may be called repeatedly."""
        while job.leave:
            job.leave.pop()()

    def report(self, job: Job, response: Response, sent: int, *, whole: bool = True) -> None:
        """Log and count a request that has ended."""
        self.context.request_log.request(
            job.request, job.plan, job.caller, response, sent, job.started, whole
        )

    def drain(self) -> None:
        """Report from now on that this server is not ready."""
        self.context.health.draining = True
        if isinstance(self.context.kb, KnowledgeBase):
            self.context.kb.stop_deriving()

    def close(self) -> bool:
        """Accept no more work and wait for the work in progress; tell whether all of it ended.

        Abandoned queries are not waited for: they may run for hours.
        """
        self.context.queries.stop_all()
        stuck = self.context.queries.has_stuck_threads()
        for pool in (self.query_pool, self.point_pool, self.pool):
            pool.shutdown(wait=not stuck, cancel_futures=True)
        self._stop_listening()
        self.context.close()
        return not stuck

    def _problem(self, error: Exception, job: Job) -> Response:
        response = problem(error, job.request.id)
        metrics = self.context.metrics
        if response.status == 429:
            metrics.count("rtask_rate_limited_total")
        if isinstance(error, AccessError):
            self.context.request_log.denied(job.request, job.caller, response.status, str(error))
        if job.plan.running is not None:
            metrics.count("rtask_query_total", form=job.plan.form, outcome=slug_of(error))
        return response

    def _finish(self, response: Response, job: Job) -> Response:
        # A query has at least what had been committed when it came; a write has its own commit.
        is_query = job.plan.form not in ("", "UPDATE")
        version = job.version if is_query else self.context.versions.current()
        headers = [
            ("Vary", "Accept, Accept-Encoding, Authorization, Cookie, Origin"),
            *cors_headers(job.request, self.context.config),
            ("RTASK-Request-Id", job.request.id),
        ]
        if job.request.method in ("GET", "HEAD"):
            sent = job.request.headers
            private = "authorization" in sent or "cookie" in sent
            headers.append(("Cache-Control", "private, no-cache" if private else "no-cache"))
        if not any(name.lower() == "rtask-version" for name, _ in response.headers):
            headers.append(("RTASK-Version", version))
        if self.context.following is not None:
            headers += staleness_headers(self.context.following)
        return response.with_headers(*headers)

    def _route(self, job: Job) -> None:
        context, request = self.context, job.request
        address = request.raw_path.rstrip("/") or "/"
        if request.method == "OPTIONS":
            job.plan = self.router.options(request, address)
            return
        match = find(address)
        if match.routes and match.routes[0].handler == "health":  # before anybody is identified
            require_method(request, match.allow)
            job.plan = context.health.plan(address)
            return
        try:
            job.caller = caller = context.auth.identify(request, limited=True)
        except AccessError:
            context.limiter.admit_stranger(request.client)
            raise
        encoding = request.headers.get("content-encoding")
        if encoding and request.body:
            allowed = context.config.max_upload_bytes
            body = unpacked(request.body, encoding, allowed)
            headers = {**request.headers, "rtask-request-id": request.id}
            request = replace(request, body=body, headers=headers)
        job.leave.append(context.limiter.admit(caller))
        following = context.following
        if following is not None and self.router.is_for_writer(request, address):
            job.plan = Plan(lambda: following.forward(request))
            return
        minimum = request.header("rtask-min-version")
        if minimum:
            wait_for = minimum_version(context.kb, minimum)
            job.plan = Plan(lambda: wait_for(self.router.plan(request, caller, address).run))
            return
        self._plan(job, request, caller, address)

    def _plan(self, job: Job, request: Request, caller: Caller, address: str) -> None:
        job.plan = self.router.plan(request, caller, address)
        if job.plan.running is not None:
            # Registered, so that it can be listed and stopped.
            job.leave.append(self.context.queries.begin(job.plan.running))
