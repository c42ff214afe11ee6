"""The interface for programs, independent of any server: one request in, one response out.

Flask and the ASGI application both pass the requests of programs to :class:`Application`. Pages for
people belong to Flask alone.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace

from endpoint.access.auth import Caller, cors_headers
from endpoint.context import ServerContext
from endpoint.follow.versions import minimum_version, staleness_headers, unknown_so_far
from endpoint.http.compression import compressed, unpacked
from endpoint.http.messages import Request, Response, require_method
from endpoint.http.plan import Plan
from endpoint.http.problems import problem, slug_of
from endpoint.lanes import Job, Lanes
from endpoint.router import Router
from endpoint.routes import find
from endpoint.sparql import protocol
from endpoint.sparql.answers import SlowerThanItLooksError
from rtask.errors import AccessError, RtaskError, TooLargeError
from rtask.knowledge_base import KnowledgeBase

MAX_WHOLE_BYTES = 64 << 20


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
        self.lanes = Lanes(context.config.max_queries, self.run, self._refused)
        self._starting: Future[None] | None = None
        self._stop_listening = context.kb.on_commit(context.request_log.commit)

    def handle(self, request: Request) -> Response:
        """Answer a request in the calling thread, abandoning queries at their time limit."""
        job = self.admit(request)
        try:
            if job.plan.timeout_s is None:
                response = self.run(job)
            else:
                work = self.lanes.submit(job)
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

    def admit_identified(self, request: Request, caller: Caller, leave: Callable[[], None]) -> Job:
        """Plan the answer to a query whose caller has been identified and admitted already.

        Parameters
        ----------
        leave
            Called when the request has ended.
        """
        job = Job(request, Plan.ready(Response()), caller, [leave])
        job.version = self.context.versions.current()
        try:
            self._plan(job, request, caller, request.raw_path.rstrip("/"))
        except Exception as error:  # noqa: BLE001 - every error is an answer
            job.plan = Plan.ready(self._problem(error, job))
        return job

    def refused(self, error: Exception, request: Request) -> Job:
        """Return the job of a request that was refused before its body was read."""
        job = Job(request, Plan.ready(Response()))
        job.plan = Plan.ready(self._problem(error, job))
        return job

    def start_reader(self) -> None:
        """Start a reader in the background, if none is being started yet."""
        readers = self.context.kb.readers
        if not readers.possible or (self._starting is not None and not self._starting.done()):
            return
        self._starting = self.lanes.work.submit(readers.start, False)

    def run(self, job: Job) -> Response:
        """Do the work of a request; errors become answers."""
        try:
            response = job.plan.run()
        except SlowerThanItLooksError:
            raise
        except Exception as error:  # noqa: BLE001 - every error is an answer
            response = self._problem(error, job)
        response = compressed(response, job.request)
        if job.plan.query is not None:
            job.plan.query.keep(response)
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
        self.lanes.close(wait=not stuck)
        self._stop_listening()
        self.context.close()
        return not stuck

    def _problem(self, error: Exception, job: Job) -> Response:
        context = self.context
        more = unknown_so_far(error, context.following, context.versions.current())
        response = problem(error, job.request.id, more)
        metrics = context.metrics
        if response.status == 429:
            metrics.count("rtask_rate_limited_total")
        if isinstance(error, AccessError):
            self.context.request_log.denied(job.request, job.caller, response.status, str(error))
        if job.plan.running is not None:
            metrics.count("rtask_query_total", form=job.plan.form, outcome=slug_of(error))
        return response

    def _refused(self, error: RtaskError, job: Job) -> Response:
        return self._finish(self._problem(error, job), job)

    def _finish(self, response: Response, job: Job) -> Response:
        # A query has at least what had been committed when it came; a write has its own commit.
        is_query = job.plan.form not in ("", "UPDATE")
        version = job.version if is_query else self.context.versions.current()
        headers = [*self.steady_fields(job.request), ("RTASK-Request-Id", job.request.id)]
        if not any(name.lower() == "rtask-version" for name, _ in response.headers):
            headers.append(("RTASK-Version", version))
        if self.context.following is not None:
            headers += staleness_headers(self.context.following)
        return response.with_headers(*headers)

    def steady_fields(self, request: Request) -> list[tuple[str, str]]:
        """Return the header fields of a response that depend on the header of the request only."""
        fields = [
            ("Vary", "Accept, Accept-Encoding, Authorization, Cookie, Origin"),
            *cors_headers(request, self.context.config),
        ]
        if request.method in ("GET", "HEAD"):
            private = "authorization" in request.headers or "cookie" in request.headers
            fields.append(("Cache-Control", "private, no-cache" if private else "no-cache"))
        return fields

    def _route(self, job: Job) -> None:
        context, request = self.context, job.request
        address = request.raw_path.rstrip("/") or "/"
        if request.method == "OPTIONS":
            job.plan = self.router.options(request, address)
            return
        match = find(address)
        if match.routes and match.routes[0].right == "public":  # before anybody is identified
            require_method(request, match.allow)
            job.plan = self.router.plan_public(request, address)
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
        if following is not None and self.router.is_for_writer(request, caller, address):
            job.plan = Plan(lambda: following.forward(request))
            return
        minimum = request.header("rtask-min-version")
        if minimum:
            wait_for = minimum_version(context.kb, minimum)

            def late() -> Response:
                plan = self.router.plan(request, caller, address)
                if plan.lane == "point" and plan.query is not None:
                    # On a thread that may wait: nothing is gained by trying whether it is quick.
                    return wait_for(plan.query.run)
                return wait_for(plan.run)

            job.plan = Plan(late)
            return
        self._plan(job, request, caller, address)

    def _plan(self, job: Job, request: Request, caller: Caller, address: str) -> None:
        job.plan = self.router.plan(request, caller, address)
        if job.plan.running is not None:
            # Registered, so that it can be listed and stopped.
            job.leave.append(self.context.queries.begin(job.plan.running))
