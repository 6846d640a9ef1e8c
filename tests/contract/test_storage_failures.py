"""Blobs that are gone, and stores that fail: the same errors directly, over REST and over gRPC."""

import hashlib
from collections.abc import Callable
from typing import Any

import obstore
import pytest
from fvs_service.storage.blob_keys import image_key
from fvs_service.storage.blobs import Blobs, _reachable
from obstore.exceptions import GenericError, PermissionDeniedError

Compare = Callable[[Callable[[Any], None]], None]

FAILURES = {
    "away": (GenericError("The store does not answer."), "cannot be reached"),
    "denies": (PermissionDeniedError("403 Forbidden"), "refuses the service's credentials"),
    "disagrees on the time": (PermissionDeniedError("403 RequestTimeTooSkewed"), "clock is wrong"),
    "without bucket": (FileNotFoundError("NoSuchBucket"), "has no such bucket"),
}
"""What a store raises, and what the error says."""


@pytest.fixture(params=FAILURES)
def failure(request: pytest.FixtureRequest) -> tuple[Exception, str]:
    return FAILURES[request.param]


@pytest.mark.parametrize("start", [0, 10])
def test_images(
    compare: Compare,
    photograph: Callable[..., bytes],
    monkeypatch: pytest.MonkeyPatch,
    start: int,
    failure: tuple[Exception, str],
) -> None:
    error, says = failure
    content = photograph(17)
    sha256 = hashlib.sha256(content).hexdigest()

    def scenario(tenant: Any) -> None:
        scene = tenant.scene()
        tenant.upload(scene, content)
        asked = {"scene_id": scene, "digest": f"sha256:{sha256}"}
        assert tenant.download("DownloadImage", start, **asked).result == content[start:]
        with monkeypatch.context() as broken:
            broken.setattr(obstore, "get", _raising(error))
            outcome = tenant.download("DownloadImage", start, **asked)
            assert (outcome.code, outcome.retryable, outcome.retry_after) == ("unavailable", True, True)
            assert says in outcome.message
        tenant.gateway.application.storage.blobs.remove(image_key(scene, sha256))
        assert tenant.download("DownloadImage", start, **asked).code == "not-found"

    compare(scenario)


@pytest.mark.parametrize("start", [0, 10])
def test_artifacts(
    compare: Compare, monkeypatch: pytest.MonkeyPatch, start: int, failure: tuple[Exception, str]
) -> None:
    error, says = failure

    def scenario(tenant: Any) -> None:
        scene = tenant.scene()
        snapshot = tenant.gateway.model(scene, headers=tenant.headers, seed=7)
        asked = {"snapshot_id": snapshot, "name": "cameras.json"}
        assert len(tenant.download("DownloadArtifact", start, **asked).result) > 100
        with monkeypatch.context() as broken:
            broken.setattr(obstore, "get", _raising(error))
            outcome = tenant.download("DownloadArtifact", start, **asked)
            assert (outcome.code, outcome.retryable, outcome.retry_after) == ("unavailable", True, True)
            assert says in outcome.message
        tenant.gateway.application.storage.blobs.remove_below(f"scenes/{scene}/artifacts/")
        assert tenant.download("DownloadArtifact", start, **asked).code == "not-found"

    compare(scenario)


@pytest.mark.parametrize("given", [{}, {"Range": "bytes=5-9"}])
@pytest.mark.parametrize("kind", ["image", "artifact"])
def test_the_head_of_a_download_has_the_same_status(
    gateway: Any,
    tenant: Any,
    photograph: Callable[..., bytes],
    monkeypatch: pytest.MonkeyPatch,
    kind: str,
    given: dict[str, str],
    failure: tuple[Exception, str],
) -> None:
    scene = tenant.scene()
    if kind == "image":
        digest = tenant.upload(scene, photograph(18)).result["digest"]
        path = f"/v1/scenes/{scene}/images/{digest}/content"
    else:
        snapshot = gateway.model(scene, headers=tenant.headers, seed=8)
        path = f"/v1/snapshots/{snapshot}/artifacts/cameras.json"
    headers = {**tenant.headers, **given}
    whole = gateway.client.head(path, headers=headers)
    assert (whole.status_code, whole.content) == (206 if given else 200, b"")
    assert (
        whole.headers["Content-Length"] == gateway.client.get(path, headers=headers).headers["Content-Length"]
    )
    monkeypatch.setattr(obstore, "get", _raising(failure[0]))
    for verb in ("HEAD", "GET"):
        answer = gateway.client.request(verb, path, headers=headers)
        assert (answer.status_code, "Retry-After" in answer.headers) == (503, True)


def test_an_upload_that_cannot_be_stored(
    compare: Compare,
    photograph: Callable[..., bytes],
    monkeypatch: pytest.MonkeyPatch,
    failure: tuple[Exception, str],
) -> None:
    error, says = failure

    def scenario(tenant: Any) -> None:
        scene, content = tenant.scene(), photograph(19)
        with monkeypatch.context() as broken:
            broken.setattr(Blobs, "adopt", _adopting(error))
            outcome = tenant.upload(scene, content)
            assert (outcome.code, outcome.retryable, outcome.retry_after) == ("unavailable", True, True)
            assert says in outcome.message
        assert tenant.call("ListImages", scene_id=scene).result["items"] == []
        assert tenant.upload(scene, content).result["verdict"] == "accepted"

    compare(scenario)


def _raising(error: Exception) -> Callable[..., Any]:
    def fail(*_: Any, **__: Any) -> Any:
        raise error

    return fail


def _adopting(error: Exception) -> Callable[..., None]:
    """Adopting that fails once the store was asked, as buckets are; the folder of these tests is not."""

    def adopt(*_: Any) -> None:
        with _reachable():
            raise error

    return adopt
