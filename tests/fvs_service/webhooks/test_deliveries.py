"""Every chosen event arrives, signed, once it can; failures are tried again, and seen."""

import re
import time
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path
from typing import Any

import orjson
import pytest
from fvs_service.settings import Settings
from fvs_service.storage.clock import now
from fvs_service.storage.tables import EventRow, SceneRow, WebhookRow
from fvs_service.webhooks import repository
from gateways import running_gateway
from sqlalchemy import update

_JOBS = ["job.queued", "job.canceled"]


def _documented() -> Callable[..., bool]:
    """The verification of the documents."""
    page = Path(__file__).parents[3] / "docs/reference/webhooks.md"
    (code,) = re.findall(r"```python\n(import base64.*?)```", page.read_text("utf-8"), re.DOTALL)
    names: dict[str, Any] = {}
    exec(code, names)
    verified: Callable[..., bool] = names["verified"]
    return verified


_verified = _documented()


def _create(gateway: Any, scene: str, url: str, events: list[str]) -> dict[str, Any]:
    made = gateway.client.post(f"/v1/scenes/{scene}/webhooks", json={"url": url, "events": events})
    assert made.status_code == 201, made.text
    return made.json()


def _state(gateway: Any, webhook: dict[str, Any]) -> dict[str, Any]:
    return gateway.client.get(f"/v1/webhooks/{webhook['id']}").json()


def _set(gateway: Any, **values: Any) -> None:
    with gateway.application.storage.database.writing() as session:
        session.execute(update(WebhookRow).values(**values))


def test_chosen_events_arrive_in_order_and_signed(gateway: Any, receiver: Any) -> None:
    scene = gateway.scene()
    gateway.queue(scene, kind="update")
    webhook = _create(gateway, scene, receiver.url, _JOBS)
    for job_id in gateway.queued_jobs():
        gateway.client.post(f"/v1/jobs/{job_id}:cancel")
    gateway.client.patch(f"/v1/scenes/{scene}", json={"name": "not chosen"})
    job_id = gateway.queue(scene)
    receiver.wait(lambda: len(receiver.received) == 2)
    assert receiver.kinds == ["job.canceled", "job.queued"], "those before the webhook are not sent"
    headers, body = receiver.received[1]
    event = orjson.loads(body)
    assert (event["scene_id"], event["data"]["job_id"]) == (scene, job_id)
    assert headers["content-type"] == "application/json"
    assert headers["webhook-id"] == f"{webhook['id']}_{event['number']}"
    assert abs(int(headers["webhook-timestamp"]) - time.time()) < 300
    assert _verified(webhook["secret"], headers, body, time.time())
    assert not _verified(webhook["secret"], headers, body[:-1], time.time())
    receiver.wait(lambda: _state(gateway, webhook)["delivered"] == event["number"])
    state = _state(gateway, webhook)
    assert (state["state"], state["pending"], state["failures"]) == ("active", 0, 0)
    assert "secret" not in state


def test_nothing_is_lost_while_the_receiver_is_down_and_the_service_restarts(
    settings: Settings, receiver: Any
) -> None:
    receiver.status = 503
    with running_gateway(settings) as gateway:
        scene = gateway.scene()
        webhook = _create(gateway, scene, receiver.url, ["scene.changed"])
        for number in range(3):
            gateway.client.patch(f"/v1/scenes/{scene}", json={"name": f"a{number}"})
        receiver.wait(lambda: _state(gateway, webhook)["failures"] >= 3)
        state = _state(gateway, webhook)
        assert (state["state"], state["pending"], state["error"]) == ("failing", 3, "The answer was 503.")
        assert state["failing_since"]
        assert len({headers["webhook-id"] for headers, _ in receiver.received}) == 1, "the first, repeatedly"
    receiver.status = 200
    receiver.received.clear()
    with running_gateway(settings) as again:
        receiver.wait(lambda: _state(again, webhook)["pending"] == 0)
        assert _state(again, webhook)["state"] == "active"
    numbers = [orjson.loads(body)["number"] for _, body in receiver.received]
    assert len(numbers) == 3
    assert numbers == sorted(numbers)


def test_each_delivery_is_made_by_one_of_many_gateways(gateway: Any, receiver: Any) -> None:
    scene = gateway.scene()
    with running_gateway(gateway.settings) as other:
        webhooks = [_create(gateway, scene, f"{receiver.url}{i}", ["scene.changed"]) for i in range(4)]
        for number in range(10):
            one = (gateway, other)[number % 2]
            one.client.patch(f"/v1/scenes/{scene}", json={"name": f"a{number}"})
        for webhook in webhooks:
            receiver.wait(lambda webhook=webhook: _state(other, webhook)["pending"] == 0)
    ids = [headers["webhook-id"] for headers, _ in receiver.received]
    assert len(ids) == len(set(ids)) == 40


def test_a_webhook_that_fails_for_long_is_disabled_until_it_is_enabled(gateway: Any, receiver: Any) -> None:
    scene = gateway.scene()
    receiver.status = 500
    webhook = _create(gateway, scene, receiver.url, ["scene.changed"])
    gateway.client.patch(f"/v1/scenes/{scene}", json={"name": "b"})
    receiver.wait(lambda: _state(gateway, webhook)["failures"] >= 1)
    _set(gateway, failing_since=now() - repository.GIVE_UP_AFTER - timedelta(seconds=1))
    receiver.wait(lambda: _state(gateway, webhook)["state"] == "disabled")
    tried = len(receiver.received)
    receiver.status = 200
    gateway.client.patch(f"/v1/scenes/{scene}", json={"name": "c"})
    assert _state(gateway, webhook)["pending"] == 2
    assert len(receiver.received) == tried
    enabled = gateway.client.post(f"/v1/webhooks/{webhook['id']}:enable")
    assert enabled.json()["state"] == "active"
    receiver.wait(lambda: _state(gateway, webhook)["pending"] == 0)
    assert len(receiver.received) == tried + 2


def test_redirects_are_not_followed(gateway: Any, receiver: Any) -> None:
    scene = gateway.scene()
    receiver.status, receiver.more = 307, {"Location": receiver.url.replace("/hook", "/elsewhere")}
    webhook = _create(gateway, scene, receiver.url, ["scene.changed"])
    gateway.client.patch(f"/v1/scenes/{scene}", json={"name": "b"})
    receiver.wait(lambda: _state(gateway, webhook)["failures"] >= 1)
    assert _state(gateway, webhook)["error"] == "The answer was 307."
    assert len({headers["webhook-id"] for headers, _ in receiver.received}) == 1


def test_a_host_that_is_no_longer_allowed_gets_nothing(gateway: Any, receiver: Any) -> None:
    scene = gateway.scene()
    webhook = _create(gateway, scene, receiver.url, ["scene.changed"])
    _set(gateway, url=receiver.url.replace("127.0.0.1", "127.0.0.2"))
    gateway.client.patch(f"/v1/scenes/{scene}", json={"name": "b"})
    receiver.wait(lambda: _state(gateway, webhook)["failures"] >= 1)
    assert "127.0.0.2 is not a host that webhooks may go to" in _state(gateway, webhook)["error"]
    assert receiver.received == []


def test_what_the_retention_deleted_is_reported(gateway: Any, receiver: Any) -> None:
    scene = gateway.scene()
    webhook = _create(gateway, scene, receiver.url, ["scene.changed"])
    _set(gateway, disabled=True)
    for number in range(3):
        gateway.client.patch(f"/v1/scenes/{scene}", json={"name": f"a{number}"})
    with gateway.application.storage.database.writing() as session:
        numbers = [row.number for row in session.query(EventRow).filter_by(scene_id=scene)]
        session.query(EventRow).filter(EventRow.number.in_(numbers[:-1])).delete()
        session.execute(update(SceneRow).where(SceneRow.id == scene).values(last_deleted_event=numbers[-2]))
    gateway.client.post(f"/v1/webhooks/{webhook['id']}:enable")
    receiver.wait(lambda: len(receiver.received) == 2)
    assert receiver.kinds == ["events.deleted", "scene.changed"]


@pytest.mark.parametrize("events", [["scene.deleted"], ["job.failed"]])
def test_a_webhook_ends_with_its_scene(gateway: Any, receiver: Any, events: list[str]) -> None:
    scene = gateway.scene()
    webhook = _create(gateway, scene, receiver.url, events)
    assert gateway.client.delete(f"/v1/scenes/{scene}").status_code == 204
    receiver.wait(lambda: gateway.client.get(f"/v1/webhooks/{webhook['id']}").status_code == 404)
    assert receiver.kinds == [kind for kind in events if kind == "scene.deleted"]


def test_a_disabled_webhook_is_deleted_with_its_scene(gateway: Any, receiver: Any) -> None:
    scene = gateway.scene()
    webhook = _create(gateway, scene, receiver.url, ["scene.deleted"])
    _set(gateway, disabled=True)
    gateway.client.delete(f"/v1/scenes/{scene}")
    assert gateway.client.get(f"/v1/webhooks/{webhook['id']}").status_code == 404


def test_a_deleted_webhook_sends_nothing(gateway: Any, receiver: Any) -> None:
    scene = gateway.scene()
    first, second = (_create(gateway, scene, receiver.url, ["scene.changed"]) for _ in range(2))
    assert gateway.client.delete(f"/v1/webhooks/{first['id']}").status_code == 204
    gateway.client.patch(f"/v1/scenes/{scene}", json={"name": "b"})
    receiver.wait(lambda: _state(gateway, second)["pending"] == 0)
    assert len(receiver.received) == 1
    listed = gateway.client.get(f"/v1/scenes/{scene}/webhooks").json()["webhooks"]
    assert [webhook["id"] for webhook in listed] == [second["id"]]


def test_a_scene_has_few_webhooks(gateway: Any, receiver: Any) -> None:
    scene = gateway.scene()
    for _ in range(10):
        _create(gateway, scene, receiver.url, ["scene.changed"])
    body = {"url": receiver.url, "events": ["scene.changed"]}
    assert gateway.client.post(f"/v1/scenes/{scene}/webhooks", json=body).status_code == 429


def test_a_claim_is_that_of_one_gateway(gateway: Any, receiver: Any) -> None:
    database = gateway.application.storage.database
    webhook = _create(gateway, gateway.scene(), receiver.url, ["scene.changed"])
    with database.writing() as session:
        claimed = repository.claim(session, webhook["id"], 60_000)
        assert claimed is not None
        assert repository.claim(session, webhook["id"], 60_000) is None
    _set(gateway, not_before_ms=1)  # it has expired
    with database.writing() as session:
        assert repository.claim(session, webhook["id"], 60_000) is not None
        assert not repository.record_delivery(session, claimed, 99, sent=True), "the first one is too late"
        repository.record_failure(session, claimed, "too late")
    assert _state(gateway, webhook)["failures"] == 0
