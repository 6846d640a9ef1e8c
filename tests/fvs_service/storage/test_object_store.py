"""Blobs in an S3-compatible object store."""

import time
from collections.abc import Iterator
from pathlib import Path
from uuid import uuid4

import pytest
from fvs_service.errors import NotFoundError, StorageRefusedError, StorageUnavailableError
from fvs_service.settings import BlobSettings
from fvs_service.storage import blobs as blobs_module
from fvs_service.storage.blobs import Blobs
from object_store_server import ACCESS_KEY_ID, SECRET_ACCESS_KEY, ObjectStoreServer
from obstore.exceptions import PermissionDeniedError

pytestmark = pytest.mark.process


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ObjectStoreServer]:
    server = ObjectStoreServer(tmp_path_factory.mktemp("store"))
    server.start()
    server.create_bucket("fvs")
    yield server
    server.stop()


@pytest.fixture
def settings(server: ObjectStoreServer) -> BlobSettings:
    """A key prefix for this test alone."""
    return BlobSettings(
        url=f"s3://fvs/{uuid4().hex}",
        endpoint=server.endpoint,
        region="us-east-1",
        access_key_id=ACCESS_KEY_ID,
        secret_access_key=SECRET_ACCESS_KEY,
    )


def read_when_ready(blobs: Blobs, key: str) -> bytes:
    """The blob, from a store that answers a while before its volumes do."""
    until = time.monotonic() + 60
    while True:
        try:
            return blobs.read(key)
        except StorageUnavailableError:
            if time.monotonic() > until:
                raise


def test_blobs_are_stored_read_listed_and_removed(settings: BlobSettings, tmp_path: Path) -> None:
    blobs = Blobs(tmp_path / "unused", settings)
    blobs.check()
    content = bytes(range(256)) * 50_000  # more than one part of a multipart upload
    file = tmp_path / "large"
    file.write_bytes(content)
    blobs.keep(file, "scenes/a/large")
    blobs.adopt(file, "scenes/a/images/x")
    assert not file.exists()
    blobs.put(b"small", "scenes/b/x")
    assert blobs.info("scenes/a/large").size_bytes == len(content)
    assert b"".join(blobs.chunks("scenes/a/large", 5_000_000, 11_000_001)) == content[5_000_000:11_000_001]
    blobs.export("scenes/a/images/x", tmp_path / "again")
    assert (tmp_path / "again").read_bytes() == content
    assert {found.key for found in blobs.below("scenes/a/")} == {"scenes/a/large", "scenes/a/images/x"}
    blobs.remove("scenes/b/x")
    blobs.remove("scenes/b/x")
    blobs.remove_below("scenes/a/")
    assert list(blobs.below("scenes/")) == []
    with pytest.raises(NotFoundError):
        blobs.read("scenes/a/large")
    assert not (tmp_path / "unused").exists()


@pytest.mark.parametrize(
    ("change", "says", "hint"),
    [
        ({"secret_access_key": "wrong"}, "refuses the service's credentials", "SECRET_ACCESS_KEY"),
        ({"access_key_id": "nobody"}, "refuses the service's credentials", "ACCESS_KEY_ID"),
        ({"url": "s3://missing"}, "no such bucket", "Create it"),
        ({"endpoint": "http://127.0.0.1:1"}, "cannot be reached", "doctor"),
    ],
)
def test_a_store_that_cannot_be_used_says_why(
    settings: BlobSettings,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    change: dict[str, str],
    says: str,
    hint: str,
) -> None:
    monkeypatch.setattr(blobs_module, "_RETRY_S", 0.1)
    blobs = Blobs(tmp_path, settings.model_copy(update=change))
    with pytest.raises(StorageUnavailableError, match=says) as found:
        blobs.check()
    assert hint in found.value.hint
    file = tmp_path / "file"
    file.write_bytes(b"content")
    for use in (
        lambda: blobs.put(b"content", "x"),
        lambda: blobs.keep(file, "x"),
        lambda: blobs.info("x"),
        lambda: blobs.exists("x"),
        lambda: blobs.read("x"),
        lambda: list(blobs.chunks("x", 0, 5)),
        lambda: blobs.export("x", tmp_path / "exported"),
        lambda: blobs.remove("x"),
        lambda: blobs.remove_below("x/"),
        lambda: list(blobs.below("")),
    ):
        with pytest.raises(StorageUnavailableError, match=says):
            use()
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_blob_that_is_stored_between_two_requests_is_found(
    settings: BlobSettings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    blobs = Blobs(tmp_path, settings)
    blobs.put(b"content", "x")
    blobs.put(b"", "empty")

    def missing(*_arguments: object) -> None:
        raise FileNotFoundError

    monkeypatch.setattr(blobs_module.obstore, "head", missing)
    assert blobs.info("x").size_bytes == 7
    assert blobs.info("empty").size_bytes == 0
    assert not blobs.exists("y")


@pytest.mark.parametrize(("request_name", "says"), [("put", "store"), ("head", "find"), ("delete", "delete")])
def test_a_right_that_the_credentials_lack_is_named(
    settings: BlobSettings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request_name: str, says: str
) -> None:
    blobs = Blobs(tmp_path, settings)
    blobs.check_rights()
    assert list(blobs.below("checks/")) == []

    def refuse(*_arguments: object) -> None:
        raise PermissionDeniedError("403 Forbidden")

    monkeypatch.setattr(blobs_module.obstore, request_name, refuse)
    blobs.check()
    with pytest.raises(StorageRefusedError, match=f"refuses to {says} blobs"):
        blobs.check_rights()


@pytest.mark.system
def test_a_store_that_comes_back_has_everything(
    server: ObjectStoreServer, settings: BlobSettings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(blobs_module, "_RETRY_S", 0.1)
    impatient = Blobs(tmp_path, settings)
    impatient.put(b"content", "x")
    server.stop()
    try:
        for use in (
            lambda: impatient.read("x"),
            lambda: impatient.exists("x"),
            lambda: list(impatient.below("")),
        ):
            with pytest.raises(StorageUnavailableError, match="cannot be reached"):
                use()
    finally:
        server.start()
    assert read_when_ready(impatient, "x") == b"content"
