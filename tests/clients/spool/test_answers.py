import json

import pytest
from fvs_client.spool.answers import Answer, RefusedError, require_success
from fvs_client.spool.draining import Backoff
from fvs_client.spool.errors import LinkError
from fvs_client.spool.pace import Pace
from fvs_client.spool.quantities import bytes_of


def _problem(status: int, code: str = "some", *, retryable: bool = False, **headers: str) -> Answer:
    document = {"status": status, "code": code, "detail": "No.", "hint": "Do this.", "retryable": retryable}
    return Answer(status, headers, json.dumps(document).encode())


def test_what_the_service_refuses_is_refused_with_its_reason() -> None:
    for status in (400, 404, 409, 413, 415, 422):
        with pytest.raises(RefusedError) as caught:
            require_success(_problem(status, "invalid-request"))
        refusal = caught.value.refusal
        assert (refusal.code, refusal.reason, refusal.hint) == ("invalid-request", "No.", "Do this.")


@pytest.mark.parametrize("status", [401, 403, 408, 423, 429, 500, 502, 503, 504, 507])
def test_what_passes_is_tried_again(status: int) -> None:
    with pytest.raises(LinkError) as caught:
        require_success(_problem(status))
    assert (str(caught.value), caught.value.hint) == ("No.", "Do this.")
    with pytest.raises(LinkError):
        require_success(_problem(409, retryable=True))


@pytest.mark.parametrize("status", [302, 400, 403, 404, 413, 502])
@pytest.mark.parametrize("content", [b"<html>Log in</html>", b"[]", b'{"error": "no"}'])
def test_an_answer_that_is_not_the_services_refuses_nothing(status: int, content: bytes) -> None:
    with pytest.raises(LinkError, match="not from an fvs service"):
        require_success(Answer(status, {}, content))


@pytest.mark.parametrize(
    ("headers", "wait_s"),
    [
        ({"retry-after": "7"}, 7.0),
        ({"retry-after": "Thu, 01 Jan 1970 00:02:00 GMT", "date": "Thu, 01 Jan 1970 00:01:30 GMT"}, 30.0),
        ({"retry-after": "Thu, 01 Jan 1970 00:01:00 GMT", "date": "Thu, 01 Jan 1970 00:01:30 GMT"}, 0.0),
        ({"retry-after": "Thu, 01 Jan 2099 00:02:00 GMT"}, 0.0),
        ({"retry-after": "soon"}, 0.0),
        ({}, 0.0),
    ],
)
def test_retry_after_is_heeded_whatever_this_machines_clock_says(
    headers: dict[str, str], wait_s: float
) -> None:
    with pytest.raises(LinkError) as caught:
        require_success(_problem(503, **headers))
    assert caught.value.retry_after_s == wait_s


def test_pauses_have_full_jitter_and_a_limit() -> None:
    longest = Backoff(0.5, 60.0, draw=lambda: 1.0)
    assert [longest.pause_s() for _ in range(9)] == [0.5, 1, 2, 4, 8, 16, 32, 60, 60]
    longest.reset()
    assert longest.pause_s(retry_after_s=10.0) == 10.5
    assert Backoff(0.5, 60.0, draw=lambda: 0.0).pause_s() == 0.0
    steady = Backoff(0.5, 60.0)
    assert all(0 <= steady.pause_s() <= 60 for _ in range(2_000))


def test_the_rate_is_kept() -> None:
    now = [0.0]

    def sleep(pause_s: float) -> None:
        now[0] += pause_s

    pace = Pace(1_000.0, clock=lambda: now[0], sleep=sleep)
    now[0] = 100.0  # what was not used before gives no burst now
    for _ in range(100):
        pace.spend(pace.block_bytes)
    assert now[0] - 100.0 == pytest.approx(100 * pace.block_bytes / 1_000.0, rel=0.01)
    unlimited = Pace(None, clock=lambda: now[0], sleep=sleep)
    unlimited.spend(10**9)
    assert now[0] < 300


def test_sizes_are_read_as_people_write_them() -> None:
    assert [bytes_of(text) for text in ("500", "64kB", "1.5 MB", "8G", "2tb")] == [
        500,
        64_000,
        1_500_000,
        8_000_000_000,
        2_000_000_000_000,
    ]
    for text in ("", "0", "-1", "big", "1 MiB", "nan"):
        with pytest.raises(ValueError, match="is not a size"):
            bytes_of(text)


@pytest.mark.parametrize(
    "headers",
    [
        {"retry-after": "9" * 400},
        {"retry-after": "864000"},
        {"retry-after": "Sat, 09 May 2026 12:00:00 GMT", "date": "Fri, 01 May 2026 12:00:00 GMT"},
    ],
)
def test_no_answer_silences_a_device_for_days(headers: dict[str, str]) -> None:
    with pytest.raises(LinkError) as caught:
        require_success(_problem(429, **headers))
    assert caught.value.retry_after_s == 3_600
