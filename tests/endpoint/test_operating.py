"""Records that a server keeps of requests: rates, metrics, log lines, the audit trail, settings."""

from __future__ import annotations

import gzip
import io
import json
import os
import random
import re
import stat
import zlib
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner
from prometheus_client.parser import text_string_to_metric_families

import rtask
from endpoint.access.auth import Caller
from endpoint.access.rate import Buckets, InFlight, Limiter
from endpoint.access.tokens import TokenStore
from endpoint.application import Application
from endpoint.commands import serve
from endpoint.http.compression import accepts_gzip, unpacked
from endpoint.http.messages import RefusedError, Request
from endpoint.monitoring.audit import Audit
from endpoint.monitoring.log import LineWriter, redacted
from endpoint.monitoring.metrics import Metrics
from endpoint.rosbridge.services import NoEngine
from endpoint.settings import Config, limits_of, read_settings, use_file
from rtask.errors import TooLargeError, UsageError
from rtask.kb.commit.access import Access
from tests.servers import new_application

FORM = {"content-type": "application/x-www-form-urlencoded", "host": "localhost"}


@pytest.fixture
def tokens() -> Iterator[TokenStore]:
    with closing(TokenStore(None)) as store:
        yield store


def open_application(tokens: TokenStore, config: Config, **more: Any) -> Application:
    return new_application(
        rtask.open(":memory:", ontologies=False), NoEngine(), tokens, config, **more
    )


def ask(text: str = "ASK {}", **headers: str) -> Request:
    body = f"query={text}".replace(" ", "+").encode()
    return Request("POST", "/sparql", "", {**FORM, **headers}, body, client="10.0.0.7")


def bearer(text: str) -> dict[str, str]:
    return {"authorization": f"Bearer {text}"}


class Clock:
    """Seconds that pass when told to."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


def test_a_bucket_gives_its_rate_and_two_seconds_of_burst() -> None:
    clock = Clock()
    buckets = Buckets(10.0, clock)
    assert [buckets.take("a") for _ in range(20)] == [0.0] * 20
    assert buckets.take("a") == pytest.approx(0.1)
    assert buckets.take("b") == 0.0  # one caller's haste is not another's
    clock.now = 0.5
    assert [buckets.take("a") for _ in range(6)] == [0.0] * 5 + [pytest.approx(0.1)]


def test_more_than_a_bucket_holds_is_taken_from_a_full_one_and_owed() -> None:
    clock = Clock()
    buckets = Buckets(1.0, clock)
    assert buckets.take("a", 20) == 0.0  # else a large request could never be made
    assert buckets.take("a") == pytest.approx(19.0)
    clock.now = 19.0
    assert buckets.take("a", 20) == pytest.approx(1.0)
    assert buckets.take("a") == 0.0


def test_a_bucket_remembers_no_more_callers_than_it_may() -> None:
    buckets = Buckets(1.0)
    for number in range(10_050):
        buckets.take(str(number))
    assert len(buckets._levels) == 10_000


def test_requests_under_way_are_counted_in_and_out() -> None:
    flights = InFlight(2)
    assert [flights.enter("a") for _ in range(3)] == [True, True, False]
    flights.leave("a")
    assert flights.enter("a")


def test_what_is_too_much_says_when_to_come_again() -> None:
    limiter, caller = Limiter(1.0, 1.0, 32, Clock()), Caller(Access("nao-1", "robot"), address="a")
    limiter.admit(caller)
    limiter.admit(caller)
    with pytest.raises(RefusedError, match="more than 1 requests per second") as refused:
        limiter.admit(caller)
    assert refused.value.http_status == 429
    assert dict(refused.value.headers)["Retry-After"] == "1"
    limiter.admit_calls(Caller(Access("nao-2", "robot"), address="b"), calls=1, changes=2)
    with pytest.raises(RefusedError, match="more than 1 changes per second"):
        limiter.admit_calls(Caller(Access("nao-2", "robot"), address="b"), calls=1, changes=1)
    with pytest.raises(RefusedError, match="more than 1 requests per second"):
        limiter.admit_calls(caller, calls=2, changes=0)


def test_a_token_is_limited_and_its_neighbour_is_not(tokens: TokenStore) -> None:
    hasty, _ = tokens.create("reader")
    calm, _ = tokens.create("reader")
    application = open_application(tokens, Config(rate=2.0), clock=Clock())
    found = [application.handle(ask(**bearer(hasty))).status for _ in range(6)]
    assert found == [200] * 4 + [429] * 2
    assert application.handle(ask(**bearer(calm))).status == 200
    assert application.context.metrics.total("rtask_rate_limited_total") == 2
    application.close()


def test_who_guesses_tokens_is_slowed_down_by_address(tokens: TokenStore) -> None:
    good, _ = tokens.create("reader")
    application = open_application(tokens, Config(rate=2.0), clock=Clock())
    guess = bearer("rtk_0123456789ab_" + "0" * 32)
    found = [application.handle(ask(**guess)).status for _ in range(6)]
    assert found == [401] * 4 + [429] * 2
    assert application.handle(ask(**bearer(good))).status == 200
    application.close()


def test_more_requests_at_once_than_a_token_may_have_are_refused(tokens: TokenStore) -> None:
    text, _ = tokens.create("reader")
    application = open_application(tokens, Config(rate=0.0, max_in_flight=2))
    jobs = [application.admit(ask(**bearer(text))) for _ in range(3)]
    assert [application.run(job).status for job in jobs] == [200, 200, 429]
    application.end(jobs[0])
    assert application.run(application.admit(ask(**bearer(text)))).status == 200
    application.close()


def test_more_queries_than_run_and_wait_are_refused_with_when_to_come_again(
    tokens: TokenStore,
) -> None:
    application = open_application(tokens, Config(max_queries=1))
    first, second = application.admit(ask()), application.admit(ask())
    third = application.run(application.admit(ask()))
    assert third.status == 503
    assert ("Retry-After", "1") in third.headers
    application.end(first)
    application.end(second)
    assert application.run(application.admit(ask())).status == 200
    application.close()


def test_metrics_are_what_prometheus_reads_and_hold_nothing_of_clients(tokens: TokenStore) -> None:
    application = open_application(tokens, Config())
    application.handle(ask())
    application.handle(Request("GET", "/store/<script>/secret", "", {"host": "localhost"}))
    application.handle(Request("BREW", "/query", "", {"host": "localhost"}))
    text = application.handle(Request("GET", "/metrics", "", {"host": "localhost"})).body.decode()
    application.close()
    families = {family.name: family for family in text_string_to_metric_families(text)}
    kinds = re.findall(r"^# TYPE (\S+)", text, re.MULTILINE)
    assert len(kinds) == len(set(kinds)), "a metric is introduced once"
    requests = {tuple(s.labels.items()): s.value for s in families["rtask_http_requests"].samples}
    assert requests[("method", "POST"), ("route", "/sparql"), ("status", "200")] == 1
    assert 'method="other"' in text
    assert "<script>" not in text
    assert families["rtask_http_request_seconds"].type == "histogram"
    assert families["process_resident_memory_bytes"].samples[0].value > 0


def test_large_numbers_are_printed_in_full() -> None:
    metrics = Metrics()
    metrics.count("rtask_commit_quads_total", 1_000_001, kind="added")
    text = metrics.text({"rtask_quads": 10_000_001}).decode()
    found = {s.name: s.value for f in text_string_to_metric_families(text) for s in f.samples}
    assert found["rtask_commit_quads_total"] == 1_000_001
    assert found["rtask_quads"] == 10_000_001


def test_the_buckets_of_a_time_add_up() -> None:
    metrics = Metrics()
    for seconds in (0.0005, 0.003, 0.003, 999.0):
        metrics.request("/sparql", "GET", 200, seconds)
    text = metrics.text({}).decode()
    samples = [s for f in text_string_to_metric_families(text) for s in f.samples]
    buckets = {s.labels["le"]: s.value for s in samples if s.name.endswith("_bucket")}
    assert [buckets[le] for le in ("0.001", "0.005", "60.0", "+Inf")] == [1, 3, 3, 4]


def test_metrics_are_for_this_machine_and_for_operators(tokens: TokenStore) -> None:
    text, _ = tokens.create("robot", agent="nao-1")
    admin, _ = tokens.create("admin")
    request = Request("GET", "/metrics", "", {"host": "localhost"})
    local, remote = (
        open_application(tokens, Config()),
        open_application(tokens, Config(host="0.0.0.0")),
    )
    assert local.handle(request).status == 200
    assert remote.handle(request).status == 401
    for application in (local, remote):
        as_robot = Request("GET", "/metrics", "", {"host": "localhost", **bearer(text)})
        as_admin = Request("GET", "/metrics", "", {"host": "localhost", **bearer(admin)})
        assert application.handle(as_robot).status == 403
        assert application.handle(as_admin).status == 200
        application.close()


def test_each_request_is_one_line_that_holds_no_secret(tokens: TokenStore) -> None:
    text, token = tokens.create("robot", agent="nao-1")
    out = io.StringIO()
    writer = LineWriter(out)
    application = open_application(tokens, Config(), writer=writer)
    application.handle(ask("SELECT * {}", **bearer(text), **{"rtask-request-id": "my-request-1"}))
    application.handle(
        Request("GET", f"/store/token={text}", "", {"host": "localhost", **bearer(text)})
    )
    application.close()
    writer.close()
    lines = [json.loads(line) for line in out.getvalue().splitlines()]
    assert len(lines) == 2
    assert (
        lines[0]
        | {
            "id": "my-request-1",
            "status": 200,
            "form": "SELECT",
            "agent": "nao-1",
            "role": "robot",
            "token": token.id,
        }
        == lines[0]
    )
    assert "text" not in lines[0]
    assert text.rpartition("_")[2] not in out.getvalue()


class Terminal(io.StringIO):
    """A stream that a person reads."""

    def isatty(self) -> bool:
        return True


def test_on_a_terminal_a_request_is_a_line_of_words(tokens: TokenStore) -> None:
    text, _ = tokens.create("robot", agent="nao-1")
    out = Terminal()
    writer = LineWriter(out)
    application = open_application(tokens, Config(), writer=writer)
    application.handle(ask("SELECT * {}", **bearer(text)))
    application.close()
    writer.close()
    assert re.fullmatch(r"\d\d:\d\d:\d\d 200 (GET|POST) /\S+, \d+ ms, nao-1\n", out.getvalue()), (
        out.getvalue()
    )


def test_a_log_that_nobody_reads_holds_nothing_up() -> None:
    reading, writing = os.pipe()
    with os.fdopen(writing, "w") as stream:
        writer = LineWriter(stream)
        for number in range(100_000):  # a pipe holds 64 KiB: to wait would be to wait forever
            writer.put({"number": number, "filler": "x" * 100})
        assert writer.dropped > 0
        os.close(reading)
        writer.close()
        writer._stream = io.StringIO()


@pytest.mark.parametrize(
    ("text", "secret"),
    [("/?token=rtk_0123456789ab_feed", "feed"), ("Bearer rtk_0123456789ab_feed", "feed")],
)
def test_secrets_are_left_out_of_logs(text: str, secret: str) -> None:
    assert secret not in redacted(text)


def test_the_audit_trail_tells_commits_and_refusals_and_is_its_owners(tmp_path: Path) -> None:
    with rtask.open(tmp_path / "kb", ontologies=False) as kb, closing(TokenStore(None)) as tokens:
        text, token = tokens.create("robot", agent="nao-1")
        application = new_application(kb, NoEngine(), tokens, Config())
        form = {**FORM, **bearer(text)}
        fine = b"update=INSERT+DATA+{<urn:s>+<urn:p>+1}"
        foreign = b"update=INSERT+DATA+{GRAPH+<urn:other>+{<urn:s>+<urn:p>+1}}"
        assert application.handle(Request("POST", "/update", "", form, fine)).status == 204
        assert application.handle(Request("POST", "/update", "", form, foreign)).status == 403
        application.close()
    file = tmp_path / "kb" / "audit.jsonl"
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    commit, denied = (json.loads(line) for line in file.read_text("utf-8").splitlines())
    assert (commit["event"], commit["agent"], commit["added"]) == ("commit", "nao-1", 1)
    assert token.id in commit["note"]
    assert commit["graphs"][0].endswith("graph/agent/nao-1")
    assert (denied["event"], denied["status"], denied["token"]) == ("denied", 403, token.id)
    assert text.rpartition("_")[2] not in file.read_text("utf-8")


def test_a_flood_of_refusals_does_not_fill_the_disk(tmp_path: Path) -> None:
    with closing(Audit(tmp_path)) as audit:
        for _ in range(5_000):
            audit.denied(401, "no")
    assert len((tmp_path / "audit.jsonl").read_text("utf-8").splitlines()) < 1_000


def test_the_provenance_of_a_change_names_its_request(tokens: TokenStore) -> None:
    application = open_application(tokens, Config())
    form = {**FORM, "rtask-request-id": "request-of-mine"}
    body = b"update=INSERT+DATA+{<urn:s>+<urn:p>+1}"
    assert application.handle(Request("POST", "/update", "", form, body)).status == 204
    noted = "ASK { ?a ?p ?note FILTER(CONTAINS(STR(?note), 'request-of-mine')) }"
    assert application.context.kb.query(noted)
    application.close()


# Settings


def test_a_file_says_what_neither_option_nor_environment_does(tmp_path: Path) -> None:
    file = tmp_path / "rtask.toml"
    file.write_text('[serve]\nhost = "::1"\nmax-rows = 10\nlimit = ["patterns=5"]\n')

    @click.command(context_settings={"auto_envvar_prefix": "RTASK"})
    @click.option("--config", type=click.Path(path_type=Path), callback=use_file, is_eager=True)
    @click.option("--host", default="127.0.0.1")
    @click.option("--max-rows", default=99)
    @click.option("--limit", multiple=True)
    def command(config: Path, host: str, max_rows: int, limit: tuple[str, ...]) -> None:
        click.echo(f"{host} {max_rows} {limit}")

    def run(*options: str, **environment: str) -> str:
        return CliRunner().invoke(command, options, env=environment).output.strip()

    assert run("--config", str(file)) == "::1 10 ('patterns=5',)"
    assert run("--config", str(file), RTASK_MAX_ROWS="20") == "::1 20 ('patterns=5',)"
    assert run("--config", str(file), "--max-rows", "30", RTASK_MAX_ROWS="20").split()[1] == "30"
    assert run(RTASK_CONFIG=str(file)).split()[1] == "10"


def test_a_setting_that_does_not_exist_is_refused_with_the_nearest(tmp_path: Path) -> None:
    file = tmp_path / "rtask.toml"
    file.write_text("[serve]\nhots = 1\n")
    with pytest.raises(UsageError, match="did you mean host"):
        read_settings(file, ["host", "port"])
    file.write_text("not toml")
    with pytest.raises(UsageError, match=r"rtask\.toml"):
        read_settings(file, ["host"])


@pytest.mark.parametrize(
    "setting", ["patterns", "patterns=0", "patterns=-1", "patterns=²", "stars=3"]
)
def test_a_limit_is_a_name_and_a_number(setting: str) -> None:
    with pytest.raises(UsageError):
        limits_of([setting])


# Bodies and answers in gzip


@pytest.mark.parametrize(
    ("header", "wanted"),
    [("gzip", True), ("deflate, gzip;q=0.5", True), ("br", False), ("gzip;q=0.1, identity", False)],
)
def test_gzip_is_sent_to_who_wants_it(header: str, wanted: bool) -> None:
    assert accepts_gzip(header) is wanted


def test_large_answers_are_compressed_and_small_ones_are_not(tokens: TokenStore) -> None:
    application = open_application(tokens, Config())
    large = ask("SELECT * { VALUES ?x {" + "1 " * 1_000 + "} }", **{"accept-encoding": "gzip"})
    answer = application.handle(large)
    assert ("Content-Encoding", "gzip") in answer.headers
    assert len(json.loads(gzip.decompress(answer.body))["results"]["bindings"]) == 1_000
    small = application.handle(ask(**{"accept-encoding": "gzip"}))
    assert "Content-Encoding" not in dict(small.headers)
    application.close()


def test_a_decompression_bomb_is_refused_before_it_is_held() -> None:
    packer = zlib.compressobj(9, wbits=31)
    bomb = b"".join(packer.compress(bytes(1 << 20)) for _ in range(64)) + packer.flush()
    assert len(bomb) < 100_000
    with pytest.raises(TooLargeError):
        unpacked(bomb, "gzip", 8 << 20)


def test_a_body_of_several_gzip_members_is_read_to_its_end() -> None:
    members = [gzip.compress(bytes([65 + n]) * 50_000 * n) for n in range(4)]
    wanted = b"".join(bytes([65 + n]) * 50_000 * n for n in range(4))
    assert unpacked(b"".join(members), "gzip", 1 << 20) == wanted
    noise = random.Random(5).randbytes(100_000)  # longer than what is read at a time
    assert unpacked(gzip.compress(noise) + gzip.compress(noise), "gzip", 1 << 20) == noise * 2
    with pytest.raises(TooLargeError, match="members"):
        unpacked(gzip.compress(b"") * 10_001, "gzip", 1 << 20)


@pytest.mark.parametrize(
    "body",
    [b"no gzip", b"", gzip.compress(b"x")[:-4], gzip.compress(b"x") + b"rest",
     gzip.compress(b"x") + gzip.compress(b"y")[:-1]],
    ids=["no gzip", "nothing", "cut off", "something behind it", "second member cut off"],
)  # fmt: skip
def test_a_broken_gzip_body_is_refused(body: bytes) -> None:
    with pytest.raises(RefusedError) as refused:
        unpacked(body, "gzip", 1_000)
    assert refused.value.http_status == 400


def test_an_unknown_encoding_is_415() -> None:
    with pytest.raises(RefusedError) as refused:
        unpacked(b"", "br", 1_000)
    assert refused.value.http_status == 415


# Conditional requests


def etag_of(application: Application, text: str, **headers: str) -> tuple[int, str]:
    answer = application.handle(ask(text, **headers))
    return answer.status, dict(answer.headers).get("ETag", "")


def test_a_query_is_not_evaluated_again_while_nothing_was_written(tokens: TokenStore) -> None:
    application = open_application(tokens, Config())
    status, etag = etag_of(application, "SELECT * { ?s ?p 1 }")
    assert status == 200
    assert etag.startswith('W/"')
    assert etag_of(application, "SELECT * { ?s ?p 1 }", **{"if-none-match": etag}) == (304, etag)
    assert etag_of(application, "SELECT * { ?s ?p 2 }", **{"if-none-match": etag})[0] == 200
    as_csv = {"if-none-match": etag, "accept": "text/csv"}
    assert etag_of(application, "SELECT * { ?s ?p 1 }", **as_csv)[0] == 200
    application.context.kb.update("INSERT DATA { <urn:s> <urn:p> 1 }")
    assert etag_of(application, "SELECT * { ?s ?p 1 }", **{"if-none-match": etag})[0] == 200
    application.close()


@pytest.mark.parametrize("call", ["NOW()", "RAND()", "UUID()", "STRUUID()", "BNODE()"])
def test_an_answer_that_changes_by_itself_has_no_tag(tokens: TokenStore, call: str) -> None:
    application = open_application(tokens, Config())
    assert etag_of(application, f"SELECT ({call} AS ?x) {{}}") == (200, "")
    application.close()


@pytest.mark.parametrize(
    "options",
    [
        ["-p", "99999"],
        ["-p", "-1"],
        ["--timeout", "-3"],
        ["--timeout", "0"],
        ["--timeout", "nan"],
        ["--max-timeout", "inf"],
        ["--max-rows", "0"],
        ["--max-queries", "0"],
        ["--max-upload", "-1"],
        ["--rate", "-1"],
        ["--drain-delay", "-1"],
        ["--min-identity", "nan"],
    ],
)
def test_settings_out_of_range_are_refused_by_name(options: list[str]) -> None:
    answer = CliRunner().invoke(serve, ["--temp", *options])
    assert answer.exit_code == 2
    assert options[0] in answer.output
    assert "Traceback" not in answer.output
