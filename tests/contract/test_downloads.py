"""Downloads whose bytes are gone or cannot be read: the same errors directly, over REST and over gRPC."""

import hashlib
from collections.abc import Callable
from typing import Any

import obstore
import pytest
from fvs_service.storage.blob_keys import image_key
from obstore.exceptions import GenericError

Compare = Callable[[Callable[[Any], None]], None]


@pytest.mark.parametrize("start", [0, 10])
def test_images(
    compare: Compare, photograph: Callable[..., bytes], monkeypatch: pytest.MonkeyPatch, start: int
) -> None:
    content = photograph(17)
    sha256 = hashlib.sha256(content).hexdigest()

    def scenario(tenant: Any) -> None:
        scene = tenant.scene()
        tenant.upload(scene, content)
        asked = {"scene_id": scene, "digest": f"sha256:{sha256}"}
        assert tenant.download("DownloadImage", start, **asked).result == content[start:]
        with monkeypatch.context() as broken:
            broken.setattr(obstore, "get", _fail)
            outcome = tenant.download("DownloadImage", start, **asked)
            assert (outcome.code, outcome.retryable) == ("unavailable", True)
        tenant.gateway.application.storage.blobs.remove(image_key(scene, sha256))
        assert tenant.download("DownloadImage", start, **asked).code == "not-found"

    compare(scenario)


@pytest.mark.parametrize("start", [0, 10])
def test_artifacts(compare: Compare, monkeypatch: pytest.MonkeyPatch, start: int) -> None:
    def scenario(tenant: Any) -> None:
        scene = tenant.scene()
        snapshot = tenant.gateway.model(scene, headers=tenant.headers, seed=7)
        asked = {"snapshot_id": snapshot, "name": "cameras.json"}
        assert len(tenant.download("DownloadArtifact", start, **asked).result) > 100
        with monkeypatch.context() as broken:
            broken.setattr(obstore, "get", _fail)
            outcome = tenant.download("DownloadArtifact", start, **asked)
            assert (outcome.code, outcome.retryable) == ("unavailable", True)
        tenant.gateway.application.storage.blobs.remove_below(f"scenes/{scene}/artifacts/")
        assert tenant.download("DownloadArtifact", start, **asked).code == "not-found"

    compare(scenario)


def _fail(*_: Any, **__: Any) -> Any:
    raise GenericError("The store does not answer.")
