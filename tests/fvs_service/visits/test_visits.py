"""Visits: what a vehicle does about a view changes what others are offered."""

from datetime import timedelta
from typing import Any

import pytest
from fvs_service.events.repository import events_after
from fvs_service.storage.clock import now
from fvs_service.storage.tables import VisitRow
from fvs_service.visits import repository, service
from sqlalchemy import func, select

from fvs_schema.events import EventKind

LOOK = {"frame": "world", "orientation_wxyz": [1.0, 0.0, 0.0, 0.0]}


def _row(count: int) -> list[dict[str, Any]]:
    """Candidates beside each other, which look at the model."""
    return [{"id": f"c{x}", "pose": {**LOOK, "position": [x + 0.5, 0.0, -4.0]}} for x in range(count)]


@pytest.fixture
def scene(gateway: Any) -> str:
    scene = gateway.scene()
    gateway.model(scene)
    return scene


def _report(
    gateway: Any, scene: str, vehicle: str, state: str, views: list[dict[str, Any]], **more: Any
) -> Any:
    document = {"vehicle": vehicle, "state": state, "views": views, **more}
    return gateway.client.post(f"/v1/scenes/{scene}/visits", json=document)


def _taken(gateway: Any, scene: str, views: list[dict[str, Any]], vehicle: str | None = None) -> set[str]:
    request = {"candidates": views, "for_vehicle": vehicle}
    answer = gateway.client.post(f"/v1/scenes/{scene}/rankings", json=request)
    assert answer.status_code == 201, answer.text
    assert {item["status"] for item in answer.json()["candidates"]} <= {"ranked", "taken"}
    return {item["id"] for item in answer.json()["candidates"] if item["status"] == "taken"}


def test_the_view_of_one_vehicle_is_taken_for_the_others(gateway: Any, scene: str) -> None:
    views = _row(3)
    answer = _report(gateway, scene, "north", "going-to", views[:1])
    assert answer.status_code == 200, answer.text
    (visit,) = answer.json()["visits"]
    assert (visit["vehicle"], visit["candidate_id"], visit["state"]) == ("north", "c0", "going-to")
    assert visit["pose"]["position"] == [0.5, 0.0, -4.0]
    assert _taken(gateway, scene, views) == _taken(gateway, scene, views, "south") == {"c0"}
    assert _taken(gateway, scene, views, "north") == set()
    # The same view in another ranking has another id, and is nearly where the first is.
    near = {"id": "near", "pose": {**LOOK, "position": [0.5, 0.01, -4.0]}}
    turned = {"id": "turned", "pose": {**near["pose"], "orientation_wxyz": [0.99, 0.0, 0.141067, 0.0]}}
    assert _taken(gateway, scene, [near, turned, *views[1:]]) == {"near"}


def test_a_photograph_that_was_taken_counts_before_it_arrives(gateway: Any, scene: str) -> None:
    views = _row(3)
    _report(gateway, scene, "north", "going-to", views[:2])
    _report(gateway, scene, "north", "taken", views[:1])
    _report(gateway, scene, "north", "failed", views[1:2])
    assert _taken(gateway, scene, views, "south") == {"c0"}
    assert _taken(gateway, scene, views, "north") == {"c0", "c1"}
    plan = gateway.client.post(
        f"/v1/scenes/{scene}/plans", json={"candidates": views, "views": 3, "for_vehicle": "south"}
    ).json()
    assert {stop["id"] for stop in plan["tours"][0]["stops"]} == {"c1", "c2"}
    assert plan["photographed"] == ["c0"]


def test_candidates_of_another_ranking_with_the_same_ids_are_other_views(gateway: Any, scene: str) -> None:
    first, second = ({"id": "around-0002", "pose": view["pose"]} for view in _row(2))
    for view in (first, second):
        for state in ("going-to", "taken"):
            assert _report(gateway, scene, "north", state, [view]).status_code == 200
    listed = gateway.client.get(f"/v1/scenes/{scene}/visits").json()["visits"]
    assert [(visit["candidate_id"], visit["state"]) for visit in listed] == [("around-0002", "taken")] * 2
    assert _taken(gateway, scene, _row(3), "south") == {"c0", "c1"}
    # As the estimate of a pose changes by the width of a hand, the view stays the same.
    near = {**first, "pose": {**first["pose"], "position": [0.5, 0.01, -4.0]}}
    listed = _report(gateway, scene, "north", "failed", [near]).json()["visits"]
    assert [visit["state"] for visit in listed] == ["taken", "failed"]
    assert _taken(gateway, scene, _row(3), "south") == {"c1"}


def test_views_beside_a_taken_one_bring_less(gateway: Any, scene: str) -> None:
    views = _row(5)

    def gains() -> dict[str, float]:
        plan = gateway.client.post(f"/v1/scenes/{scene}/plans", json={"candidates": views, "views": 1}).json()
        return {term["id"]: term["gain"] for term in plan["candidates"]}

    before = gains()
    _report(gateway, scene, "north", "taken", [{**views[2], "id": "x"}])
    after = gains()
    assert after.keys() == before.keys() - {"c2"}
    assert after["c3"] < 0.9 * before["c3"]
    (asked,) = gateway.client.post(f"/v1/scenes/{scene}/rankings", json={"candidates": views}).json()[
        "candidates"
    ][-1:]
    assert asked["status"] == "taken"
    assert [view.name for view in gateway.runners.asked[-1].taken] == ["taken:0"]


def test_two_vehicles_that_want_one_view_at_once_are_told(gateway: Any, scene: str) -> None:
    views = _row(3)
    assert _report(gateway, scene, "north", "going-to", views[:1]).status_code == 200
    refused = _report(gateway, scene, "south", "going-to", views)
    assert refused.status_code == 409
    assert "north flies to c0" in refused.json()["detail"]
    listed = gateway.client.get(f"/v1/scenes/{scene}/visits").json()["visits"]
    assert [(visit["vehicle"], visit["candidate_id"]) for visit in listed] == [("north", "c0")]
    assert _report(gateway, scene, "north", "going-to", views[:1]).status_code == 200  # it repeats itself
    assert _report(gateway, scene, "south", "going-to", views[1:]).status_code == 200


def test_a_report_is_an_event_and_a_refused_one_is_none(gateway: Any, scene: str) -> None:
    views = _row(2)
    _report(gateway, scene, "north", "going-to", views)
    assert _report(gateway, scene, "south", "going-to", views).status_code == 409
    with gateway.application.storage.database.reading() as session:
        reports = [one for one in events_after(session, scene, 0) if one.kind is EventKind.VISITS_REPORTED]
    (event,) = reports
    assert event.data == {"vehicle": "north", "state": "going-to", "candidate_ids": ["c0", "c1"]}


def test_reports_expire(gateway: Any, scene: str, monkeypatch: pytest.MonkeyPatch) -> None:
    views = _row(2)
    _report(gateway, scene, "north", "going-to", views[:1], expires_in_s=60)
    _report(gateway, scene, "north", "going-to", views[1:], expires_in_s=600)
    later = now() + timedelta(seconds=61)
    monkeypatch.setattr(repository, "now", lambda: later)
    assert _taken(gateway, scene, views) == {"c1"}
    assert _report(gateway, scene, "south", "going-to", views[:1]).status_code == 200
    with gateway.application.storage.database.reading() as session:
        count = select(func.count()).select_from(VisitRow).where(VisitRow.scene_id == scene)
        assert session.scalar(count) == 2  # the expired one is gone


def test_a_scene_has_a_limit_of_visits(gateway: Any, scene: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "_MOST", 2)
    views = _row(3)
    assert _report(gateway, scene, "north", "taken", views[:2]).status_code == 200
    refused = _report(gateway, scene, "north", "taken", views[2:])
    assert (refused.status_code, refused.json()["code"]) == (429, "limit-exceeded")
    assert _report(gateway, scene, "north", "failed", views[:2]).status_code == 200


def test_a_geodetic_view_needs_a_georeferenced_scene(gateway: Any, scene: str) -> None:
    pose = {
        "latitude_deg": 48.3,
        "longitude_deg": 7.25,
        "altitude_m": 400.0,
        "yaw_deg": 0.0,
        "pitch_deg": 0.0,
    }
    refused = _report(gateway, scene, "north", "going-to", [{"id": "a", "pose": pose}])
    assert refused.status_code == 422
    assert "not georeferenced" in refused.json()["detail"]


def test_visits_go_with_their_scene(gateway: Any, scene: str) -> None:
    _report(gateway, scene, "north", "going-to", _row(1))
    assert gateway.client.delete(f"/v1/scenes/{scene}").status_code == 204
    with gateway.application.storage.database.reading() as session:
        assert session.scalar(select(VisitRow).where(VisitRow.scene_id == scene)) is None
