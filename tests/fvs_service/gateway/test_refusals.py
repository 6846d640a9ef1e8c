"""Keys whose requests are refused again and again."""

from collections.abc import Iterator
from typing import Any

import pytest
from fvs_service.errors import (
    ConflictError,
    DigestMismatchError,
    ForbiddenError,
    InvalidRequestError,
    LimitExceededError,
    MalformedRequestError,
    NotFoundError,
    PayloadTooLargeError,
    ServiceError,
    UnauthenticatedError,
    UnsupportedMediaTypeError,
)
from fvs_service.gateway.refusals import Refusals
from fvs_service.principal import Principal, Scope
from fvs_service.telemetry import Metrics

_LIMIT = 3
_WRONG = InvalidRequestError("It is wrong.")
_CALLER = Principal("tenant", frozenset(Scope), key_id="0123")


class _Clock:
    now = 1_000.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> _Clock:
    return _Clock()


@pytest.fixture
def refusals(clock: _Clock) -> Refusals:
    return Refusals(_LIMIT, Metrics(), clock)


def _hold_s(refusals: Refusals, key: str = "key") -> int:
    try:
        refusals.check(key, with_body=True)
    except LimitExceededError as error:
        return error.retry_after_s or -1
    return 0


def test_a_key_is_on_hold_until_a_minute_after_the_first_of_too_many(
    refusals: Refusals, clock: _Clock
) -> None:
    for _ in range(_LIMIT):
        assert _hold_s(refusals) == 0
        refusals.count("key", _CALLER, _WRONG)
        clock.now += 10
    assert _hold_s(refusals) == 30
    assert _hold_s(refusals, "another key") == 0
    refusals.count("key", _CALLER, _WRONG)  # was on its way already
    clock.now += 29.5
    assert _hold_s(refusals) == 1
    clock.now += 0.5
    assert _hold_s(refusals) == 0
    refusals.count("key", _CALLER, _WRONG)
    assert _hold_s(refusals) == 10


def test_a_key_may_have_the_same_number_in_each_minute(refusals: Refusals, clock: _Clock) -> None:
    for _ in range(20):
        refusals.count("key", _CALLER, _WRONG)
        clock.now += 60 / (_LIMIT - 1)
        assert _hold_s(refusals) == 0


def test_keys_without_refusals_are_forgotten(refusals: Refusals, clock: _Clock) -> None:
    for number in range(100):
        refusals.count(f"key {number}", _CALLER, _WRONG)
        clock.now += 30
    assert len(refusals._times) <= 3


def test_a_wrong_key_is_remembered_for_a_minute(refusals: Refusals, clock: _Clock) -> None:
    refusals.count("key", None, UnauthenticatedError("Wrong.", hint="Fix it."))
    for with_body in (True, False):
        with pytest.raises(UnauthenticatedError, match=r"Wrong\.") as refused:
            refusals.check("key", with_body=with_body)
        assert refused.value.hint == "Fix it."
    refusals.check("another key", with_body=True)
    clock.now += 60
    refusals.check("key", with_body=True)


def test_not_all_wrong_keys_are_remembered(refusals: Refusals, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fvs_service.gateway.refusals._MOST_WRONG_KEYS", 10)
    for number in range(100):
        refusals.count(f"key {number}", None, UnauthenticatedError("Wrong."))
    assert len(refusals._wrong) == 10
    refusals.check("key 0", with_body=True)
    with pytest.raises(UnauthenticatedError):
        refusals.check("key 99", with_body=True)


@pytest.mark.parametrize(
    ("error", "counts"),
    [
        (MalformedRequestError("a"), True),
        (InvalidRequestError("a"), True),
        (PayloadTooLargeError("a"), True),
        (UnsupportedMediaTypeError("a"), True),
        (DigestMismatchError("a"), False),
        (UnauthenticatedError("a"), False),
        (ForbiddenError("a"), False),
        (NotFoundError("a"), False),
        (ConflictError("a"), False),
        (LimitExceededError("a"), False),
    ],
    ids=lambda given: given.code if isinstance(given, ServiceError) else "",
)
def test_only_what_the_request_is_to_blame_for_counts(
    refusals: Refusals, error: ServiceError, counts: bool
) -> None:
    for _ in range(_LIMIT):
        refusals.count("key", _CALLER, error)
    assert (_hold_s(refusals) > 0) is counts


@pytest.fixture(scope="module")
def locked(tmp_path_factory: pytest.TempPathFactory, running: Any, settings_of: Any) -> Iterator[Any]:
    limits = {"refusals_per_key": _LIMIT}
    settings = settings_of(tmp_path_factory.mktemp("locked"), {"require_keys": True, "limits": limits})
    with running(settings) as gateway:
        yield gateway


_WRONG_REQUESTS: dict[str, dict[str, Any]] = {
    "malformed": {"content": b"{", "headers": {"Content-Type": "application/json"}},
    "invalid": {"json": {"name": 1}},
    "too large": {"json": {"name": "a" * 70_000}},
    "unsupported": {"content": b"{}", "headers": {"Content-Type": "text/plain"}},
    "encoded": {
        "content": b"{}",
        "headers": {"Content-Type": "application/json", "Content-Encoding": "gzip"},
    },
}


@pytest.mark.parametrize("sent", _WRONG_REQUESTS.values(), ids=_WRONG_REQUESTS)
def test_wrong_requests_put_their_key_on_hold(locked: Any, sent: dict[str, Any]) -> None:
    key, other = locked.key("tenant"), locked.key("tenant")
    wrong = {**sent, "headers": {**sent.get("headers", {}), **key}}
    scene = locked.scene(key)
    for _ in range(_LIMIT):
        assert locked.client.post("/v1/scenes", **wrong).status_code in (400, 413, 415, 422)
    held = locked.client.post("/v1/scenes", json={"name": "a"}, headers=key)
    assert (held.status_code, held.json()["code"]) == (429, "limit-exceeded")
    assert 55 <= int(held.headers["Retry-After"]) <= 60
    assert "GET /openapi.json" in held.json()["hint"]
    assert locked.client.get(f"/v1/scenes/{scene}", headers=key).status_code == 200
    assert locked.scene(other)  # of the same tenant


def test_a_wrong_key_puts_no_other_on_hold(locked: Any) -> None:
    key = locked.key("tenant")
    stolen = {"Authorization": key["Authorization"][:-3] + "abc"}
    for _ in range(2 * _LIMIT):
        assert locked.client.post("/v1/scenes", content=b"{", headers=stolen).status_code == 401
        assert locked.client.post("/v1/scenes", json={"name": 1}, headers=stolen).status_code == 401
    assert locked.scene(key)


def test_a_wrong_key_is_looked_up_once(locked: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    key, looked_up = locked.key("tenant")["Authorization"], []
    wrong = {"Authorization": key[:-3] + "abc"}
    first = locked.client.get("/v1/scenes", headers=wrong)
    assert first.status_code == 401
    monkeypatch.setattr(locked.application.storage.keys, "authenticate", looked_up.append)
    again = locked.client.get("/v1/scenes", headers=wrong)
    assert (again.status_code, again.headers["WWW-Authenticate"]) == (401, "Bearer")
    assert again.json() == {**first.json(), "request_id": again.json()["request_id"]}
    assert looked_up == []
    assert locked.client.get("/livez", headers=wrong).status_code == 200


def test_no_spelling_of_a_key_evades_the_hold(locked: Any) -> None:
    key = locked.key("tenant")["Authorization"].partition(" ")[2]
    for _ in range(_LIMIT):
        locked.client.post("/v1/scenes", json={}, headers={"Authorization": f"Bearer {key}"})
    for spelling in (f"bearer {key}", f"Bearer  {key}", f"Bearer {key.replace('fvs_', 'abc_')}"):
        sent = {"Authorization": spelling}
        assert locked.client.post("/v1/scenes", json={}, headers=sent).status_code in (401, 429)
    twice = [("Authorization", f"Bearer {key}"), ("Authorization", "Bearer another")]
    assert locked.client.post("/v1/scenes", json={}, headers=twice).status_code == 429


def test_who_needs_no_key_is_never_on_hold(open_gateway: Any) -> None:
    gateway = open_gateway(limits={"refusals_per_key": _LIMIT})
    for _ in range(2 * _LIMIT):
        assert gateway.client.post("/v1/scenes", json={}).status_code == 422
    assert gateway.scene()


def test_holds_are_counted(locked: Any) -> None:
    key = locked.key("tenant")

    def counted(name: str) -> float:
        return locked.app.state.metrics.registry.get_sample_value(name)

    holds, requests = counted("fvs_key_holds_total"), counted("fvs_held_requests_total")
    for _ in range(_LIMIT + 2):
        locked.client.post("/v1/scenes", json={}, headers=key)
    assert counted("fvs_key_holds_total") == holds + 1
    assert counted("fvs_held_requests_total") == requests + 2
