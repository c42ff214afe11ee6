"""The context shared by all parts of a server, whatever interface a request comes through."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from endpoint.access.auth import Authenticator
from endpoint.access.rate import Limiter
from endpoint.access.rights import Rights
from endpoint.access.tokens import TokenStore
from endpoint.activity.log import ActivityLog
from endpoint.http.conditional import Versions
from endpoint.http.following import Following
from endpoint.monitoring.audit import Audit
from endpoint.monitoring.health import Health
from endpoint.monitoring.log import LineWriter
from endpoint.monitoring.metrics import Metrics
from endpoint.monitoring.request_log import RequestLog
from endpoint.monitoring.running_queries import RunningQueries
from endpoint.rosbridge.services import Engine
from endpoint.served import ServedGraph
from endpoint.settings import Config
from rtask.knowledge_base import KnowledgeBase
from rtask.services import ServiceHost


@dataclass(frozen=True)
class ServerContext:
    """The shared parts of one server.

    Parameters
    ----------
    kb
        The knowledge base.
    engine
        Carries out operations and services.
    tokens
        Access tokens.
    config
        Settings.
    auth, rights, limiter
        Identify callers, check what they may do and limit their rates.
    metrics, audit, health, queries, request_log
        What operators see of the server.
    versions
        Entity tags of answers.
    activity
        What robots do at this moment.
    services
        Carries out calls of services.
    gauges
        Further values for ``/metrics``, measured when asked for.
    following
        The connection to the server that this one follows; none if it is nobody's follower.
    at_close
        Called when the server closes.
    """

    kb: ServedGraph
    engine: Engine
    tokens: TokenStore
    config: Config
    auth: Authenticator
    rights: Rights
    limiter: Limiter
    metrics: Metrics
    audit: Audit
    health: Health
    queries: RunningQueries
    request_log: RequestLog
    versions: Versions
    services: ServiceHost
    activity: ActivityLog = field(default_factory=ActivityLog)
    gauges: dict[str, Callable[[], float]] = field(default_factory=dict)
    following: Following | None = None
    at_close: list[Callable[[], None]] = field(default_factory=list)

    @classmethod
    def create(
        cls,
        kb: ServedGraph,
        engine: Engine,
        tokens: TokenStore,
        config: Config,
        writer: LineWriter | None = None,
        clock: Callable[[], float] = time.monotonic,
        services: ServiceHost | None = None,
        following: Following | None = None,
    ) -> ServerContext:
        """Make the parts of a server.

        Parameters
        ----------
        writer
            Receives log lines; none to keep no log.
        clock
            Returns the seconds by which rates, sessions and tickets are measured; tests pass their
            own.
        services
            The services to offer; none to offer none.
        following
            The connection to the server that this one follows.
        """
        metrics, audit = Metrics(), Audit(kb.folder)
        gauges: dict[str, Callable[[], float]] = {}
        if writer is not None:
            gauges["rtask_log_lines_dropped_total"] = lambda: writer.dropped
        if isinstance(kb, KnowledgeBase):
            kb.proposes_axioms = config.propose_axioms
            kb.writer.committer.has_schema = tokens.has_schema
            kb.writer.committer.max_change = config.max_change
            gauges["rtask_writers_waiting"] = lambda: kb.write_queue()[0]
            gauges["rtask_writer_wait_seconds"] = lambda: kb.write_queue()[1]
        if following is not None:
            gauges["rtask_follower_commits_behind"] = lambda: following.commits_behind
            gauges["rtask_follower_seconds_behind"] = lambda: following.seconds_behind
            gauges["rtask_follower_records_waiting"] = lambda: following.records_waiting
            gauges["rtask_follower_records_dropped_total"] = lambda: following.records_dropped
        auth = Authenticator(tokens, config, clock)
        return cls(
            kb=kb,
            engine=engine,
            tokens=tokens,
            config=config,
            auth=auth,
            rights=Rights(auth, kb, config),
            limiter=Limiter(config.rate, config.write_rate, config.max_in_flight, clock),
            metrics=metrics,
            audit=audit,
            health=Health(kb, following),
            queries=RunningQueries(config.max_queries),
            request_log=RequestLog(metrics, audit, config, kb, writer),
            versions=Versions(kb),
            services=services or ServiceHost(),
            gauges=gauges,
            following=following,
        )

    def close(self) -> None:
        """Close the services and the audit trail; the caller closes the rest."""
        for close in self.at_close:
            close()
        self.services.close()
        self.versions.close()
        self.audit.close()
