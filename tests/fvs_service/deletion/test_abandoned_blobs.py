"""A blob that gets no row, whatever came between, is removed by the sweeps; the doctor need not find it."""

import io
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from functools import partial
from typing import Any

import pytest
from fvs_service.doctor.examination import examine
from fvs_service.errors import StorageUnavailableError
from fvs_service.images import repository
from fvs_service.principal import LOCAL_USER
from fvs_service.storage.clock import now
from fvs_service.storage.tables import RemovalRow
from PIL import Image
from sqlalchemy import select, update


@pytest.fixture
def gateway(open_gateway: Callable[..., Any]) -> Any:
    """A gateway whose store has nothing but what the test leaves."""
    return open_gateway()


def _sweep(gateway: Any, keys: str = "%") -> None:
    """Do all removals of such keys, those that are due later too."""
    storage = gateway.application.storage
    past = now() - timedelta(days=1)
    waiting = update(RemovalRow).where(RemovalRow.removed_at.is_(None), RemovalRow.key.like(keys))
    for _ in range(2):
        with storage.database.writing() as session:
            session.execute(waiting.values(due_at=past, created_at=past))
        storage.removals.run()


def _blobs(gateway: Any, scene: str) -> list[str]:
    return [blob.key for blob in gateway.application.storage.blobs.below(f"scenes/{scene}/")]


def _removals(gateway: Any) -> list[str]:
    with gateway.application.storage.database.reading() as session:
        return list(session.scalars(select(RemovalRow.key).where(RemovalRow.removed_at.is_(None))))


def _orphans(gateway: Any) -> list[str]:
    found = examine(gateway.application.storage, timedelta(0))
    return [finding.what for finding in found if finding.kind == "blob without row"]


def _away(*_: object) -> None:
    raise StorageUnavailableError("The database is away.")


def test_an_inspection_that_outlasts_its_scene_and_the_grace_leaves_nothing(
    gateway: Any, photograph: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = gateway.scene()
    inspector = gateway.application.images._inspector
    inspect = inspector.inspect

    def slow(path: Any) -> Any:
        found = inspect(path)
        gateway.application.deletions.scene(LOCAL_USER, scene)
        _sweep(gateway)
        return found

    monkeypatch.setattr(inspector, "inspect", slow)
    assert gateway.put(scene, photograph(1)).status_code == 404
    _sweep(gateway)
    assert _blobs(gateway, scene) == []


def test_an_image_whose_row_fails_is_removed_and_can_be_sent_again(
    gateway: Any, photograph: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = gateway.scene()
    with monkeypatch.context() as patch:
        patch.setattr(repository, "add_image", _away)
        assert gateway.put(scene, photograph(1)).status_code == 503
    assert len(_blobs(gateway, scene)) == 2  # with its thumbnail
    assert _orphans(gateway) == []
    _sweep(gateway)
    assert _blobs(gateway, scene) == []
    assert gateway.put(scene, photograph(1)).status_code == 201
    assert _removals(gateway) == []
    _sweep(gateway)
    assert len(_blobs(gateway, scene)) == 2  # with its thumbnail


def test_artifacts_of_a_commit_that_never_came_are_removed(
    gateway: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = gateway.scene()
    with monkeypatch.context() as patch:
        patch.setattr(gateway.application.storage.snapshots, "_add", _away)
        with pytest.raises(StorageUnavailableError):
            gateway.model(scene)
    assert _blobs(gateway, scene)
    assert _orphans(gateway) == []
    _sweep(gateway)
    assert _blobs(gateway, scene) == []


def test_a_render_whose_ranking_is_undone_before_it_is_stored_is_removed(
    gateway: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = gateway.scene()
    gateway.model(scene)
    ranking = gateway.client.post(
        f"/v1/scenes/{scene}/rankings", json={"generator": {"kind": "orbit", "count": 8}}
    ).json()
    first, second = (
        f"/v1/rankings/{ranking['id']}/candidates/{candidate['id']}/render.png"
        for candidate in ranking["candidates"][:2]
    )
    assert gateway.client.get(first).status_code == 200
    assert _removals(gateway) == []
    _sweep(gateway)
    assert gateway.client.get(first).status_code == 200
    blobs = gateway.application.storage.blobs
    put = blobs.put

    def put_too_late_and_fail(content: bytes, key: str) -> None:
        gateway.application.deletions.ranking(LOCAL_USER, ranking["id"])
        _sweep(gateway, "%/")  # as after the grace
        put(content, key)
        _away()

    with monkeypatch.context() as patch:
        patch.setattr(blobs, "put", put_too_late_and_fail)
        assert gateway.client.get(second).status_code == 503
    assert any("/rankings/" in key for key in _blobs(gateway, scene))
    assert _orphans(gateway) == []
    _sweep(gateway)
    assert not any("/rankings/" in key for key in _blobs(gateway, scene))


def test_a_render_of_a_ranking_that_is_gone_is_not_stored(
    gateway: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = gateway.scene()
    gateway.model(scene)
    ranking = gateway.client.post(
        f"/v1/scenes/{scene}/rankings", json={"generator": {"kind": "orbit", "count": 8}}
    ).json()
    runners = gateway.runners
    render = runners.render

    async def slow(request: Any) -> Any:
        gateway.application.deletions.ranking(LOCAL_USER, ranking["id"])
        return await render(request)

    monkeypatch.setattr(runners, "render", slow)
    path = f"/v1/rankings/{ranking['id']}/candidates/{ranking['candidates'][0]['id']}/render.png"
    assert gateway.client.get(path).status_code == 200
    assert not any("/rankings/" in key for key in _blobs(gateway, scene))


def test_a_removal_that_was_put_off_after_the_sweep_read_it_waits(
    gateway: Any, photograph: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A deleted image is sent again while a sweep is under way, and the gateway ends before its row."""
    scene, storage = gateway.scene(), gateway.application.storage
    digest = gateway.put(scene, photograph(1)).json()["digest"]
    gateway.client.delete(f"/v1/scenes/{scene}/images/{digest}")
    due = next(one for one in storage.removals._due() if "/images/" in one[0])
    blobs = gateway.application.images._blobs
    adopt = blobs.adopt

    def killed(file: Any, key: str) -> None:
        storage.removals._remove(*due)
        adopt(file, key)
        raise StorageUnavailableError("The gateway was killed.")

    with monkeypatch.context() as patch:
        patch.setattr(blobs, "adopt", killed)
        assert gateway.put(scene, photograph(1)).status_code == 503
    assert _removals(gateway)
    _sweep(gateway)
    assert _blobs(gateway, scene) == []
    assert _orphans(gateway) == []


def test_of_two_images_with_the_same_pixels_sent_at_once_one_keeps_its_bytes(
    gateway: Any, photograph: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, picture = gateway.scene(), Image.open(io.BytesIO(photograph(1)))

    def png(level: int) -> bytes:
        out = io.BytesIO()
        picture.save(out, "PNG", compress_level=level)
        return out.getvalue()

    blobs, both = gateway.application.images._blobs, threading.Barrier(2)
    adopt = blobs.adopt

    def together(file: Any, key: str) -> None:
        adopt(file, key)
        both.wait(30)

    monkeypatch.setattr(blobs, "adopt", together)
    contents = [png(1), png(9)]
    with ThreadPoolExecutor(2) as pool:
        verdicts = [answer.json()["verdict"] for answer in pool.map(partial(gateway.put, scene), contents)]
    assert sorted(verdicts) == ["accepted", "duplicate"]
    _sweep(gateway)
    assert len(_blobs(gateway, scene)) == 2  # with its thumbnail
    assert _orphans(gateway) == []
