import json
import socket
import time
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler
from typing import Any

import pytest
from fvs_client import (
    ApiError,
    Client,
    ConnectionFailedError,
    ForbiddenError,
    LimitExceededError,
    NotFoundError,
    Retries,
    ServiceFailedError,
    UnavailableError,
    UnexpectedAnswerError,
)
from fvs_client.errors import DeadlineExceededError, DigestMismatchError, FvsError, error_of

from fvs_schema.problems import Problem

Act = Callable[[BaseHTTPRequestHandler], None]

HEALTHY = {"status": "ok"}


def answer(status: int, document: Any, headers: dict[str, str] | None = None) -> Act:
    def act(handler: BaseHTTPRequestHandler) -> None:
        body = json.dumps(document).encode() if not isinstance(document, bytes) else document
        handler.send_response(status)
        for name, value in (headers or {}).items():
            handler.send_header(name, value)
        handler.send_header("Content-Length", str(len(body)))
        handler.end_headers()
        handler.wfile.write(body)

    return act


def problem(status: int, code: str, *, retryable: bool, **headers: str) -> Act:
    document = {
        "type": "about:blank",
        "title": "no",
        "status": status,
        "code": code,
        "detail": "It does not work.",
        "hint": "Try it otherwise.",
        "retryable": retryable,
        "request_id": "req_1",
        "errors": [{"field": "name", "message": "too long"}],
    }
    return answer(status, document, {name.replace("_", "-"): value for name, value in headers.items()})


def hang_up(handler: BaseHTTPRequestHandler) -> None:
    handler.connection.shutdown(socket.SHUT_RDWR)
    handler.close_connection = True


def quick(script: Any, **options: Any) -> Client:
    return Client(script.url, retries=Retries(**{"first_s": 0.0, **options}))


BUSY = problem(503, "unavailable", retryable=True)


@pytest.mark.parametrize(
    "act", [BUSY, hang_up, answer(502, b"<html>"), problem(429, "limit-exceeded", retryable=True)]
)
def test_transient_failures_are_tried_again(script: Any, act: Act) -> None:
    script.acts = [act, act, answer(200, HEALTHY)]
    with quick(script) as client:
        assert client.health().status == "ok"
    assert len(script.requests) == 3
    assert len({headers["x-request-id"] for _, _, headers, _ in script.requests}) == 1


@pytest.mark.parametrize(
    ("act", "error"),
    [
        (problem(404, "not-found", retryable=False), NotFoundError),
        (problem(403, "forbidden", retryable=False), ForbiddenError),
        (problem(409, "a-new-code", retryable=True), ApiError),
        (problem(500, "internal", retryable=False), ServiceFailedError),
        (problem(504, "deadline-exceeded", retryable=True), DeadlineExceededError),
        (answer(200, b"<html>"), UnexpectedAnswerError),
        (answer(200, {"state": "unheard of"}), UnexpectedAnswerError),
    ],
)
def test_other_failures_are_not(script: Any, act: Act, error: type[Exception]) -> None:
    script.acts = [act]
    with quick(script) as client, pytest.raises(error):
        client.health()
    assert len(script.requests) == 1


def test_attempts_end(script: Any) -> None:
    script.acts = [BUSY]
    with quick(script, attempts=3) as client, pytest.raises(UnavailableError) as caught:
        client.health()
    assert len(script.requests) == 3
    error = caught.value
    assert (error.status, error.problem.code, error.request_id) == (503, "unavailable", "req_1")
    assert (str(error), error.hint, error.retryable) == ("It does not work.", "Try it otherwise.", True)
    assert error.errors[0].field == "name"


def test_a_post_is_repeated_under_one_key_of_its_own(script: Any) -> None:
    script.acts = [hang_up, BUSY, problem(422, "invalid-request", retryable=False)]
    with quick(script) as client:
        for _ in range(2):
            with pytest.raises(ApiError):
                client.scenes.create("quarry")
    keys = [headers["idempotency-key"] for _, _, headers, _ in script.requests]
    assert keys[0] == keys[1] == keys[2] != keys[3]
    assert len({body for _, _, _, body in script.requests}) == 1


def test_a_given_idempotency_key_is_used(script: Any) -> None:
    script.acts = [problem(422, "invalid-request", retryable=False)]
    with quick(script) as client, pytest.raises(ApiError):
        client.scenes.create("quarry", idempotency_key="flight-7")
    assert script.requests[0][2]["idempotency-key"] == "flight-7"


def test_what_would_do_it_twice_is_sent_once(script: Any, url: str) -> None:
    with Client(url) as real:
        scene = real.scenes.create("quarry")
        job = scene.update().cancel()
    script.acts = [BUSY]
    with quick(script) as client:
        elsewhere = job.model_copy()
        elsewhere._session = client._session
        with pytest.raises(UnavailableError):
            elsewhere.retry()
        assert len(script.requests) == 1
        with pytest.raises(UnavailableError):
            elsewhere.cancel()
        assert len(script.requests) == 6


def test_retry_after_is_waited_for(script: Any) -> None:
    script.acts = [problem(429, "limit-exceeded", retryable=True, Retry_After="1"), answer(200, HEALTHY)]
    began = time.monotonic()
    with quick(script) as client:
        client.health()
    assert time.monotonic() - began >= 1.0


def test_a_retry_after_beyond_all_patience_is_told_at_once(script: Any) -> None:
    script.acts = [problem(429, "limit-exceeded", retryable=True, Retry_After="3600")]
    with quick(script) as client, pytest.raises(LimitExceededError) as caught:
        client.health()
    assert caught.value.retry_after_s == 3600
    assert len(script.requests) == 1


def test_the_key_and_the_name_of_the_client_are_sent(script: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FVS_URL", f"{script.url}/")
    monkeypatch.setenv("FVS_API_KEY", "fvs_from_environment")
    script.acts = [answer(200, HEALTHY)]
    with Client() as client:
        client.health()
    with Client(api_key="fvs_given") as client:
        client.health()
    sent = [headers for _, _, headers, _ in script.requests]
    assert [headers["authorization"] for headers in sent] == [
        "Bearer fvs_from_environment",
        "Bearer fvs_given",
    ]
    assert sent[0]["user-agent"].startswith("fvs-client/")


@pytest.mark.process
def test_nobody_there_is_said_in_words() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        url = f"http://127.0.0.1:{taken.getsockname()[1]}"
        with (
            Client(url, retries=Retries(attempts=1)) as client,
            pytest.raises(ConnectionFailedError) as caught,
        ):
            client.health()
    assert url in str(caught.value)
    assert "fvs serve" in caught.value.hint
    assert caught.value.request_id


def test_silence_ends(script: Any) -> None:
    script.acts = [lambda handler: time.sleep(1.0) or hang_up(handler)]  # type: ignore[func-returns-value]
    with Client(script.url, timeout_s=0.1, retries=Retries(attempts=1)) as client:
        began = time.monotonic()
        with pytest.raises(ConnectionFailedError, match="in time"):
            client.health()
        assert time.monotonic() - began < 1.0


@pytest.mark.parametrize("end", ["/", "/v1", "/v1/"])
def test_a_url_may_have_the_prefix_of_the_routes(url: str, end: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FVS_URL", url + end)
    with Client() as client:
        assert client.url == url
        assert "v1" in client.capabilities().api


def test_a_url_that_is_none_is_refused() -> None:
    for url in ("localhost:8000", "ftp://example.org", "grpc://example.org:8001", "http://"):
        with pytest.raises(ValueError, match="is not the URL"):
            Client(url)


def test_newer_words_and_fields_are_kept_or_left_out(script: Any, url: str) -> None:
    with Client(url) as real:
        scene = real.scenes.create("quarry")
    document = json.loads(scene.model_dump_json(by_alias=True))
    document["colour"] = "blue"
    document["policy"] |= {"trigger": "at-dawn", "hour": 6}
    script.acts = [answer(200, document)]
    with quick(script) as client:
        found = client.scenes.get(scene.id)
    assert found.policy.trigger == "at-dawn"
    assert found.name == "quarry"


def failure(status: int, retry_after_s: float | None = None, code: str = "") -> FvsError:
    return error_of(Problem(status=status, code=code, retryable=True), retry_after_s)


def test_pauses_grow_have_full_jitter_and_end() -> None:
    longest = Retries(draw=lambda: 1.0)
    assert [longest.pause_s(failure(503), attempt, 0) for attempt in range(1, 6)] == [0.5, 1, 2, 4, None]
    assert Retries(draw=lambda: 0.0).pause_s(failure(503), 3, 0) == 0.0
    assert Retries(attempts=20, draw=lambda: 1.0).pause_s(failure(503), 12, 0) == 8.0
    drawn = {Retries().pause_s(failure(503), 2, 0) for _ in range(50)}
    assert len(drawn) > 40
    assert all(pause is not None and 0 <= pause <= 1 for pause in drawn)


def test_retry_after_comes_before_jitter_and_counts_against_patience() -> None:
    retries = Retries(draw=lambda: 0.5)
    assert retries.pause_s(failure(429, 10.0), 1, 0) == 10.25
    assert retries.pause_s(failure(429, 10.0), 1, 55.0) is None


def test_damage_on_the_way_is_worth_another_try() -> None:
    damaged = failure(422, code="digest-mismatch")
    assert isinstance(damaged, DigestMismatchError)
    assert Retries().pause_s(damaged, 1, 0) is not None
    assert Retries().pause_s(failure(422, code="invalid-request"), 1, 0) is None
    assert Retries().pause_s(failure(507, code="out-of-space"), 1, 0) is None
