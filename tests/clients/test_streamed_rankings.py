"""Rankings whose candidates come as they are scored: what breaks in the middle, over both transports."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from fvs_client import Client, DeadlineExceededError, Orbit, Retries, Scene, ScoredCandidate
from fvs_service.errors import ServiceError, UnavailableError, deadline_passed

SOON_S = 60.0
ORBIT = Orbit(count=6, radius_m=9.0)


class Breaking:
    """Runners that stop after two of six candidates: with an error, or until nobody waits any longer."""

    def __init__(self, runners: Any, errors: list[ServiceError]) -> None:
        self._stream, self._errors = runners.stream, errors
        self.closed = 0

    async def __call__(self, request: Any) -> Any:
        try:
            async for number, step in _numbered(self._stream(request)):
                if number == 2 and self._errors:
                    raise self._errors.pop(0)
                yield step
        finally:
            self.closed += 1


async def _numbered(steps: Any) -> Any:
    number = 0
    async for step in steps:
        yield number, step
        number += 1


@pytest.fixture
def scene(gateway: Any, url: str) -> Iterator[Scene]:
    retries = Retries(first_s=0.01, longest_s=0.05)
    with Client(url, retries=retries) as client:
        scene = client.scenes.create("quarry")
        gateway.model(scene.id)
        yield scene


@pytest.fixture
def breaking(gateway: Any, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Breaking]:
    def with_errors(*errors: ServiceError) -> Breaking:
        breaking = Breaking(gateway.runners, list(errors))
        monkeypatch.setattr(gateway.runners, "stream", breaking)
        return breaking

    return with_errors


def test_a_stream_that_breaks_is_asked_for_again(scene: Scene, breaking: Callable[..., Breaking]) -> None:
    breaking(UnavailableError("The runner is gone."))
    scored: list[ScoredCandidate] = []
    ranking = scene.rank(generator=ORBIT, on_scored=scored.extend)
    assert len(scored) == 2 + 6
    assert {one.id for one in scored} == {one.id for one in ranking.candidates}
    assert all(one.score is not None and one.pose for one in scored)


def test_an_error_in_the_middle_is_the_error_of_a_ranking(
    scene: Scene, breaking: Callable[..., Breaking]
) -> None:
    breaking(deadline_passed(5.0))
    scored: list[ScoredCandidate] = []
    with pytest.raises(DeadlineExceededError, match=r"There was no answer within 5 s\.") as caught:
        scene.rank(generator=ORBIT, on_scored=scored.extend)
    assert len(scored) == 2
    assert caught.value.hint
    assert caught.value.request_id


def test_who_has_seen_enough_raises_and_the_service_stops(
    scene: Scene, breaking: Callable[..., Breaking]
) -> None:
    runners = breaking()

    def enough(_scored: object) -> None:
        raise LookupError

    with pytest.raises(LookupError):
        scene.rank(generator=ORBIT, on_scored=enough)
    until = time.monotonic() + SOON_S
    while not runners.closed:
        assert time.monotonic() < until
        time.sleep(0.01)
