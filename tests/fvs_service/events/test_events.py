import itertools
import json
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest
from fvs_service.events.repository import events_after, last_number, skip_lost_numbers
from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session

from fvs_schema.stages import Stage


def _messages(lines: Iterator[str]) -> Iterator[dict[str, str]]:
    message: dict[str, str] = {}
    for line in lines:
        if line.startswith(":"):
            yield {"comment": line[1:].strip()}
        elif line:
            name, _, value = line.partition(": ")
            message[name] = value
        elif "data" in message:
            yield message
            message = {}
        else:
            message = {}


@pytest.fixture
def server(serve: Any) -> Any:
    return serve(event_heartbeat_s=0.2)


def test_past_and_coming_events_arrive_in_order(server: Any) -> None:
    scene, other = server.scene(), server.scene()
    job_id = server.queue(scene)
    seen: list[dict[str, str]] = []
    with server.client.stream("GET", f"/v1/scenes/{scene}/events") as stream:
        assert stream.headers["content-type"].startswith("text/event-stream")
        messages = _messages(stream.iter_lines())
        seen += [next(messages), next(messages)]
        server.queue(other)
        canceling = threading.Thread(target=lambda: server.application.jobs.cancel(_local(), job_id))
        canceling.start()
        seen.append(next(message for message in messages if "event" in message))
        canceling.join()
    assert [message["event"] for message in seen] == ["scene.created", "job.queued", "job.canceled"]
    data = [json.loads(message["data"]) for message in seen]
    assert {event["scene_id"] for event in data} == {scene}
    assert data[1]["data"]["job_id"] == job_id
    numbers = [int(message["id"]) for message in seen]
    assert numbers == sorted(numbers)


def test_events_carry_what_a_page_shows(gateway: Any, photograph: Any) -> None:
    scene = gateway.scene()
    sent = gateway.put(scene, photograph(4), name="a.jpg", captured_at="2026-05-01T09:00:00Z").json()
    digest = sent["digest"]
    snapshot = gateway.model(scene)
    job_id = gateway.queue(scene, "fine")
    lease, ledger = gateway.lease(scene), gateway.application.storage.ledger
    ledger.start(lease, job_id, 1)
    ledger.report(lease, job_id, Stage.TRAINING, 0.5, 30.0)
    with gateway.application.storage.database.reading() as session:
        got = {event.kind.value: event.data for event in events_after(session, scene, 0)}
    gateway.application.storage.leases.release(lease)
    assert got["image.received"] == {name: sent[name] for name in sent.keys() - {"scene_id"}}
    of_job = {"job_id": job_id, "kind": "fine", "attempt": 1}
    assert got["job.queued"] == got["job.started"] == of_job
    assert got["job.progress"] == {**of_job, "stage": "training", "progress": 0.5, "eta_s": 30.0}
    made = gateway.client.get(f"/v1/snapshots/{snapshot}").json()
    shown = {name: made[name] for name in ("job_id", "kind", "metrics", "alignment")}
    assert got["snapshot.created"] == {"snapshot_id": snapshot, **shown}
    ended = {"job_id": made["job_id"], "kind": "update", "attempt": 1, "error": None, "warnings": []}
    assert got["job.succeeded"] == {**ended, "snapshot_id": snapshot}
    changed = gateway.client.post(f"/v1/scenes/{scene}/images/{digest}:exclude")
    assert changed.status_code == 200, changed.text
    with gateway.application.storage.database.reading() as session:
        excluded = events_after(session, scene, 0)[-1]
    assert excluded.kind == "image.excluded"
    assert excluded.data == {
        name: changed.json()[name] for name in ("digest", "name", "registration", "reason", "hint", "finding")
    }


def test_a_starting_service_gives_new_events_numbers_that_no_lost_event_had(server: Any) -> None:
    database = server.application.storage.database
    server.scene()
    with database.reading() as session:
        before = last_number(session)
    with database.writing() as session:
        skip_lost_numbers(session)
    server.scene()
    with database.reading() as session:
        assert last_number(session) > before + 1_000


def test_a_broken_stream_resumes_where_it_ended(server: Any) -> None:
    scene = server.scene()
    server.queue(scene)
    with server.client.stream("GET", f"/v1/scenes/{scene}/events") as stream:
        first = next(_messages(stream.iter_lines()))
    headers = {"Last-Event-ID": first["id"]}
    with server.client.stream("GET", f"/v1/scenes/{scene}/events", headers=headers) as stream:
        second = next(_messages(stream.iter_lines()))
    assert (first["event"], second["event"]) == ("scene.created", "job.queued")
    with server.client.stream("GET", f"/v1/scenes/{scene}/events", params={"after": first["id"]}) as stream:
        assert next(_messages(stream.iter_lines())) == second


def test_a_stream_that_is_ahead_of_a_restored_backup_begins_with_the_gap(server: Any) -> None:
    scene = server.scene()
    headers = {"Last-Event-ID": "1000000"}
    with server.client.stream("GET", f"/v1/scenes/{scene}/events", headers=headers) as stream:
        messages = (message for message in _messages(stream.iter_lines()) if "event" in message)
        gap = next(messages)
        server.queue(scene)
        assert next(messages)["event"] == "job.queued"
    assert gap["event"] == "events.deleted"
    assert int(gap["id"]) < 1_000_000


def test_a_tail_leaves_out_the_past_unless_it_is_resumed(server: Any) -> None:
    scene = server.scene()
    path = f"/v1/scenes/{scene}/events"
    with server.client.stream("GET", path, params={"tail": True}) as stream:
        messages = _messages(stream.iter_lines())
        server.queue(scene)
        first = next(message for message in messages if "event" in message)
    assert first["event"] == "job.queued"
    earlier = {"Last-Event-ID": str(int(first["id"]) - 1)}
    with server.client.stream("GET", path, params={"tail": True}, headers=earlier) as stream:
        assert next(_messages(stream.iter_lines())) == first


def test_a_stream_says_first_from_where_it_can_be_resumed(server: Any) -> None:
    scene = server.scene()
    with server.client.stream("GET", f"/v1/scenes/{scene}/events", params={"tail": True}) as stream:
        head = list(itertools.takewhile(bool, stream.iter_lines()))
    with server.client.stream("GET", f"/v1/scenes/{scene}/events") as stream:
        newest = next(_messages(stream.iter_lines()))["id"]
    assert head == ["retry: 1000", f"id: {newest}"]


def test_a_quiet_stream_says_that_it_lives(server: Any) -> None:
    scene = server.scene()
    with server.client.stream("GET", f"/v1/scenes/{scene}/events") as stream:
        messages = _messages(stream.iter_lines())
        next(messages)
        assert next(messages) == {"comment": "heartbeat"}


def test_streams_are_limited_and_places_come_back(serve: Any) -> None:
    server = serve(limits={"event_streams_per_tenant": 2})
    scene = server.scene()
    path = f"/v1/scenes/{scene}/events"
    with server.client.stream("GET", path) as one, server.client.stream("GET", path) as two:
        watched = [_messages(stream.iter_lines()) for stream in (one, two)]  # dropped ones would be closed
        for messages in watched:
            next(messages)
        with server.client.stream("GET", path) as refused:
            assert refused.status_code == 429
            assert refused.headers["retry-after"] == "1"
    deadline = time.monotonic() + 10
    while True:
        with server.client.stream("GET", path) as stream:
            if stream.status_code == 200:
                break
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_a_stream_of_no_scene_is_not_found(gateway: Any) -> None:
    answer = gateway.client.get("/v1/scenes/scn_none/events")
    assert (answer.status_code, answer.json()["code"]) == (404, "not-found")
    assert gateway.client.get("/v1/scenes/x/events", headers={"Last-Event-ID": "x"}).status_code == 422


def _local() -> Any:
    from fvs_service.principal import LOCAL_USER

    return LOCAL_USER


def test_events_arrive_when_they_are_committed(serve: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fvs_service.events.feed._POLL_S", 3600)
    server = serve()
    scene = server.scene()
    with server.client.stream("GET", f"/v1/scenes/{scene}/events", params={"tail": True}) as stream:
        messages = _messages(stream.iter_lines())
        server.queue(scene)
        assert next(message for message in messages if "event" in message)["event"] == "job.queued"


def test_a_lost_notification_only_delays_events(serve: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fvs_service.events.repository.announce", lambda *_: None)
    monkeypatch.setattr("fvs_service.events.feed._POLL_S", 0.02)
    server = serve()
    scene = server.scene()
    with server.client.stream("GET", f"/v1/scenes/{scene}/events", params={"tail": True}) as stream:
        messages = _messages(stream.iter_lines())
        server.queue(scene)
        assert next(message for message in messages if "event" in message)["event"] == "job.queued"


def test_streams_go_on_when_the_database_was_away(serve: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    failed = threading.Event()

    def fail_once(session: Session) -> int:
        if not failed.is_set():
            failed.set()
            raise OperationalError("SELECT", {}, Exception("the server restarts"))
        return last_number(session)

    server = serve()
    scene = server.scene()
    with server.client.stream("GET", f"/v1/scenes/{scene}/events", params={"tail": True}) as stream:
        messages = _messages(stream.iter_lines())
        monkeypatch.setattr("fvs_service.events.feed.last_number", fail_once)
        assert failed.wait(30)
        server.queue(scene)
        assert next(message for message in messages if "event" in message)["event"] == "job.queued"
