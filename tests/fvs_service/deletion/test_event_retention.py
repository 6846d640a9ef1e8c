"""Events that are no longer kept, and the streams that ask for them."""

import itertools
import json
from datetime import timedelta
from typing import Any

import pytest
from fvs_service.deletion.event_retention import EventRetention
from fvs_service.events.repository import events_after, last_number, publish
from fvs_service.settings import Retention
from fvs_service.storage.clock import now
from fvs_service.storage.tables import EventRow
from sqlalchemy import update

from fvs_schema.events import EventKind


def _retention(gateway: Any, events: int | None = None, event_days: float | None = None) -> EventRetention:
    keep = Retention(events=events, event_days=event_days)
    return EventRetention(gateway.application.storage.database, keep)


def _numbers(gateway: Any, scene: str, after: int = 0) -> list[tuple[int, str]]:
    with gateway.application.storage.database.reading() as session:
        return [(event.number, event.kind.value) for event in events_after(session, scene, after)]


def _scene_with_events(gateway: Any, count: int) -> tuple[str, list[int]]:
    """A scene with so many events, and their numbers."""
    scene = gateway.scene()
    with gateway.application.storage.database.writing() as session:
        for _ in range(count - 1):
            publish(session, scene, EventKind.SCENE_CHANGED, {})
    return scene, [number for number, _ in _numbers(gateway, scene)]


def test_a_scene_keeps_its_newest_events(open_gateway: Any) -> None:
    gateway = open_gateway()
    (many, numbers), (few, _) = _scene_with_events(gateway, 7), _scene_with_events(gateway, 3)
    retention = _retention(gateway, events=3)
    assert retention.apply() == 4
    assert retention.apply() == 0
    assert _numbers(gateway, many, numbers[3])[0] == (numbers[4], "scene.changed")
    assert len(_numbers(gateway, many, numbers[3])) == len(_numbers(gateway, few)) == 3
    with gateway.application.storage.database.writing() as session:
        publish(session, many, EventKind.SCENE_CHANGED, {})
    assert retention.apply() == 1


def test_old_events_go_and_those_of_deleted_scenes_stay(open_gateway: Any) -> None:
    gateway = open_gateway()
    (old, numbers), (deleted, _) = _scene_with_events(gateway, 4), _scene_with_events(gateway, 2)
    assert gateway.client.delete(f"/v1/scenes/{deleted}").status_code == 204
    with gateway.application.storage.database.writing() as session:
        long_ago = update(EventRow).values(created_at=now() - timedelta(days=9))
        session.execute(long_ago.where(EventRow.number != numbers[3]))
    assert _retention(gateway, event_days=10).apply() == 0
    assert _retention(gateway, event_days=8).apply() == 3
    assert _numbers(gateway, old, numbers[2]) == [(numbers[3], "scene.changed")]
    assert [kind for _, kind in _numbers(gateway, deleted)] == ["scene.deleted"]
    assert _retention(gateway).apply() == 0


def test_a_stream_of_new_events_lacks_nothing_when_all_were_old(open_gateway: Any) -> None:
    gateway = open_gateway()
    scene, numbers = _scene_with_events(gateway, 3)
    database = gateway.application.storage.database
    with database.writing() as session:
        session.execute(update(EventRow).values(created_at=now() - timedelta(days=9)))
    retention = _retention(gateway, event_days=8)
    assert [retention.apply(), retention.apply()] == [2, 0]
    with database.reading() as session:
        assert last_number(session) == numbers[-1]
    assert _numbers(gateway, scene, numbers[-1]) == []
    assert [number for number, _ in _numbers(gateway, scene)] == numbers[1:]


@pytest.mark.parametrize("event", ["first", "last"])
def test_a_stream_says_which_events_it_lacks(serve: Any, event: str) -> None:
    server = serve()
    scene, numbers = _scene_with_events(server, 5)
    _retention(server, events=2).apply()
    resumed = 0 if event == "first" else numbers[2] - 1
    path, headers = f"/v1/scenes/{scene}/events", {"Last-Event-ID": str(resumed)}
    with server.client.stream("GET", path, headers=headers) as stream:
        data = (line.removeprefix("data: ") for line in stream.iter_lines() if line.startswith("data: "))
        got = [json.loads(line) for line in itertools.islice(data, 3)]
    assert [event["kind"] for event in got] == ["events.deleted", "scene.changed", "scene.changed"]
    assert [event["number"] for event in got] == numbers[2:]
    assert got[0]["data"] == {"reason": "retention"}
    headers = {"Last-Event-ID": str(numbers[2])}
    with server.client.stream("GET", path, headers=headers) as stream:
        first = next(line for line in stream.iter_lines() if line.startswith("event: "))
    assert first == "event: scene.changed"
