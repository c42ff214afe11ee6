"""All addresses that programs use, free of any server: one request in, one response out.

Flask and the asynchronous front both hand their requests to :class:`Gateway`; pages for people are
Flask's alone.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace

from endpoint.access.auth import Authenticator, Caller, cors_headers
from endpoint.access.rate import Limiter
from endpoint.access.tokens import TokenStore
from endpoint.config import Config
from endpoint.http.compression import compressed, unpacked
from endpoint.http.conditional import Versions
from endpoint.http.messages import RefusedError, Request, Response
from endpoint.http.problems import problem, slug_of
from endpoint.monitoring.audit import Audit
from endpoint.monitoring.health import Health
from endpoint.monitoring.log import LineWriter
from endpoint.monitoring.metrics import Metrics
from endpoint.monitoring.request_log import Report
from endpoint.rosbridge.services import Engine
from endpoint.router import Addresses, serves
from endpoint.sparql import protocol
from endpoint.sparql.answers import Answers, SlowerThanItLooksError
from endpoint.sparql.deferred import Plan
from endpoint.sparql.running_queries import RunningQueries
from rtask.errors import AccessError, RtaskError, TooLargeError
from rtask.knowledge_base import KnowledgeBase

THREADS = 32
POINT_THREADS = 8
MAX_WHOLE_BYTES = 64 << 20
MAX_ABANDONED = 16


@dataclass
class Job:
    """A request on its way.

    Parameters
    ----------
    request
        As it came in.
    plan
        What is to be done.
    caller
        Who asks; none where that was not asked, or not found out.
    leave
        Called when the request has ended.
    """

    request: Request
    plan: Plan
    caller: Caller | None = None
    leave: list[Callable[[], None]] = field(default_factory=list)
    started: float = field(default_factory=time.perf_counter)


class Gateway:
    """Answers requests from programs.

    Parameters
    ----------
    kb
        The knowledge base.
    engine
        Behind ``/engine/<operation>``.
    tokens
        Who may do what.
    config
        Settings of the server.
    writer
        Where request lines go; none writes no log.
    """

    def __init__(
        self,
        kb: KnowledgeBase,
        engine: Engine,
        tokens: TokenStore,
        config: Config,
        writer: LineWriter | None = None,
    ) -> None:
        self.kb = kb
        self.engine = engine
        self.tokens = tokens
        self.config = config
        self.auth = Authenticator(tokens, config)
        self.metrics = Metrics()
        self.audit = Audit(kb.folder)
        self.queries = RunningQueries(config.max_queries)
        self.health = Health(kb)
        self.versions = Versions(kb)
        self._report = Report(self.metrics, self.audit, config, kb, writer)
        self._limiter = Limiter(config.rate, config.write_rate, config.max_in_flight)
        answers = Answers(kb, config)
        self._addresses = Addresses(self, answers)
        # What runs long has threads of its own, so that a write or a health check never waits
        # behind queries.
        self.pool = ThreadPoolExecutor(THREADS, thread_name_prefix="work")
        self.query_pool = ThreadPoolExecutor(config.max_queries, thread_name_prefix="query")
        self.point_pool = ThreadPoolExecutor(POINT_THREADS, thread_name_prefix="point")
        self._abandoned: set[Future[Response]] = set()
        self.more_gauges: dict[str, Callable[[], float]] = {}
        self._stop_listening = kb.on_commit(self._report.commit)

    def serves(self, path: str) -> bool:
        """Tell whether an address is one of programs; the others are pages."""
        return serves(path)

    def handle(self, request: Request) -> Response:
        """Answer a request in the calling thread; queries are given up at their time-out."""
        job = self.admit(request)
        try:
            if job.plan.timeout_s is None:
                response = self.run(job)
            else:
                work = self.submit(job)
                try:
                    response = work.result(job.plan.timeout_s)
                except TimeoutError:
                    response = self.give_up(work, job)
        except BaseException:
            self.end(job)
            raise
        if response.chunks is not None:
            response = self._read_whole(job, response)
        self.end(job)
        self.report(job, response, len(response.body))
        return response

    def _read_whole(self, job: Job, response: Response) -> Response:
        """Read an answer: nobody tells when a WSGI server has sent the last piece."""
        assert response.chunks is not None
        pieces, size = [response.body], len(response.body)
        try:
            for piece in response.chunks:
                pieces.append(piece)
                size += len(piece)
                if size > MAX_WHOLE_BYTES:
                    raise TooLargeError(
                        f"the answer is above {MAX_WHOLE_BYTES} bytes; add a LIMIT",
                        limit=MAX_WHOLE_BYTES,
                    )
        except RtaskError as error:
            return self._finish(self._problem(error, job), job.request)
        finally:
            response.chunks.close()
        return replace(response, body=b"".join(pieces), chunks=None)

    def admit(self, request: Request) -> Job:
        """Understand a request; never raises, errors are answers."""
        job = Job(request, Plan.ready(Response()))
        try:
            self._route(job)
        except Exception as error:  # noqa: BLE001 - every error is an answer
            job.plan = Plan.ready(self._problem(error, job))
        return job

    def refused(self, error: Exception, request: Request) -> Job:
        """Return a request that is refused before it was read."""
        job = Job(request, Plan.ready(Response()))
        job.plan = Plan.ready(self._problem(error, job))
        return job

    def submit(self, job: Job) -> Future[Response]:
        """Start the work of a request in a thread that suits it."""
        if job.plan.lane == "point":
            return self._submit_point(job)
        pool = self.query_pool if job.plan.lane == "query" else self.pool
        return pool.submit(self.run, job)

    def _submit_point(self, job: Job) -> Future[Response]:
        """Start a query that looks quick; if it is not, it goes on among the long ones."""
        answer: Future[Response] = Future()

        def first() -> None:
            if not answer.set_running_or_notify_cancel():
                return
            try:
                answer.set_result(self.run(job))
            except SlowerThanItLooksError:
                assert job.plan.again is not None
                job.plan = replace(job.plan, run=job.plan.again, lane="query", again=None)
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

    def run(self, job: Job) -> Response:
        """Do the work of a request; never raises."""
        try:
            response = job.plan.run()
        except SlowerThanItLooksError:
            raise
        except Exception as error:  # noqa: BLE001 - every error is an answer
            response = self._problem(error, job)
        return self._finish(compressed(response, job.request), job.request)

    def give_up(self, work: Future[Response], job: Job) -> Response:
        """Answer for work that took too long; a thread that cannot be stopped is counted."""
        if not work.cancel():
            self._abandoned.add(work)
            work.add_done_callback(self._abandon)
        self.metrics.count("rtask_query_aborted_total", reason="timeout")
        return self._finish(problem(self._timed_out(job), job.request.id), job.request)

    def _timed_out(self, job: Job) -> RefusedError:
        running, seconds = job.plan.running, job.plan.timeout_s
        if running is not None:
            running.stop()
            seconds = running.timeout_s
        return protocol.timed_out(seconds or self.config.timeout_s, self.config)

    def _abandon(self, work: Future[Response]) -> None:
        self._abandoned.discard(work)
        response = None if work.cancelled() else work.result()
        if response is not None and response.chunks is not None:
            response.chunks.close()

    def end(self, job: Job) -> None:
        """Count a request out; harmless when repeated."""
        while job.leave:
            job.leave.pop()()

    def report(self, job: Job, response: Response, sent: int, *, whole: bool = True) -> None:
        """Log and count a request that has ended."""
        self._report.request(job.request, job.plan, job.caller, response, sent, job.started, whole)

    def gauges(self) -> dict[str, float]:
        """Return what others have to say in the metrics; the front adds its connections."""
        return {name: value() for name, value in self.more_gauges.items()}

    def note_denied(
        self, request: Request, caller: Caller | None, status: int, detail: str
    ) -> None:
        """Keep that somebody was not let."""
        self._report.denied(request, caller, status, detail)

    def drain(self) -> None:
        """Say from now on that this server is not ready."""
        self.health.draining = True

    def close(self) -> bool:
        """Take no more work and wait for what runs; tell whether all of it ended.

        Queries that were given up are not waited for: they may run for hours.
        """
        self.queries.stop_all()
        stuck = any(not work.done() for work in self._abandoned)
        for pool in (self.query_pool, self.point_pool):
            pool.shutdown(wait=not stuck, cancel_futures=True)
        self.pool.shutdown(wait=not stuck, cancel_futures=True)
        self._stop_listening()
        self.versions.close()
        self.audit.close()
        return not stuck

    def _problem(self, error: Exception, job: Job) -> Response:
        response = problem(error, job.request.id)
        if response.status == 429:
            self.metrics.count("rtask_rate_limited_total")
        if isinstance(error, AccessError):
            self.note_denied(job.request, job.caller, response.status, str(error))
        if job.plan.running is not None:
            self.metrics.count("rtask_query_total", form=job.plan.form, outcome=slug_of(error))
        return response

    def _finish(self, response: Response, request: Request) -> Response:
        headers = [
            ("Vary", "Accept, Accept-Encoding, Authorization, Cookie, Origin"),
            ("RTASK-Version", self.versions.current()),
            ("RTASK-Request-Id", request.id),
            *cors_headers(request, self.config),
        ]
        if request.method in ("GET", "HEAD"):
            private = "authorization" in request.headers or "cookie" in request.headers
            headers.append(("Cache-Control", "private, no-cache" if private else "no-cache"))
        return response.with_headers(*headers)

    # Addresses

    def _route(self, job: Job) -> None:
        request = job.request
        address = request.raw_path.rstrip("/") or "/"
        if request.method == "OPTIONS":
            job.plan = self._addresses.options(request, address)
            return
        if address == "/health" or request.raw_path.startswith("/health/"):
            job.plan = self.health.plan(address)
            return
        try:
            job.caller = caller = self.auth.identify(request)
        except AccessError:
            self.count_stranger(request)
            raise
        encoding = request.headers.get("content-encoding")
        if encoding and request.body:
            allowed = self.config.max_upload_bytes
            request = replace(request, body=unpacked(request.body, encoding, allowed))
        self._admit(job, caller)
        job.plan = self._addresses.plan(request, caller, address)
        if job.plan.running is not None:
            # Listed, so that it can be seen and stopped.
            job.leave.append(self.queries.begin(job.plan.running))

    def check_room(self) -> None:
        """Refuse a query while too many that took too long still run.

        Raises
        ------
        RefusedError
            503, with the time to wait.
        """
        if len(self._abandoned) >= MAX_ABANDONED:
            raise RefusedError(
                503,
                "busy",
                f"{MAX_ABANDONED} queries that took too long still run; try again later",
                headers=(("Retry-After", "30"),),
            )

    def _admit(self, job: Job, caller: Caller) -> None:
        """Count a request in; this machine is not limited while nobody needs a token."""
        if caller.access.role != "anonymous":
            job.leave.append(self._limiter.admit(caller.key))

    def admit_write(self, caller: Caller) -> None:
        """Count a change; the same callers are free."""
        if caller.access.role != "anonymous":
            self._limiter.admit_write(caller.key)

    def count_page(self, caller: Caller) -> None:
        """Count a page that somebody opens; the same allowance as for programs."""
        if caller.access.role != "anonymous":
            self._limiter.admit(caller.key)()

    def count_stranger(self, request: Request) -> None:
        """Slow down who guesses: a caller without rights has its address's allowance."""
        self._limiter.admit(f"stranger {request.client}")()
