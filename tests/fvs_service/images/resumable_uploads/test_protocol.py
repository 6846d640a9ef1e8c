"""The tus protocol: requests, offsets, checksums, versions and metadata."""

from collections.abc import Iterator
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from typing import Any

import httpx2
import pytest
from tus_device import TYPE, VERSION, Device, bytes_on_disk, checksum, descriptions, sha256_of, tus_metadata


def test_options_tells_what_is_supported(gateway: Any) -> None:
    answer = gateway.client.options("/v1/uploads")
    assert answer.status_code == 204
    assert answer.headers["tus-resumable"] == answer.headers["tus-version"] == "1.0.0"
    assert set(answer.headers["tus-extension"].split(",")) == {
        *("creation", "creation-with-upload", "expiration", "checksum", "termination")
    }
    assert int(answer.headers["tus-max-size"]) == gateway.settings.limits.video_bytes
    assert set(answer.headers["tus-checksum-algorithm"].split(",")) == {"sha1", "sha256"}


def test_an_image_arrives_in_parts_with_the_verdict_of_a_put(gateway: Any, device: Device) -> None:
    made = device.create(filename="DSC_1.jpg", yaw_deg="10.5")
    assert made.status_code == 201
    assert made.headers["tus-resumable"] == "1.0.0"
    assert made.headers["upload-offset"] == "0"
    left_s = (parsedate_to_datetime(made.headers["upload-expires"]) - datetime.now(UTC)).total_seconds()
    assert 0.9 * gateway.settings.partial_upload_s < left_s <= gateway.settings.partial_upload_s
    state = device.head()
    assert (state.status_code, state.headers["upload-offset"]) == (200, "0")
    assert state.headers["upload-length"] == str(len(device.content))
    assert state.headers["cache-control"] == "no-store"
    given = {"scene": device.scene, "sha256": sha256_of(device.content)}
    assert state.headers["upload-metadata"] == tus_metadata(**given, filename="DSC_1.jpg", yaw_deg="10.5")
    assert "upload-expires" in state.headers

    first = device.patch(0, 1000)
    assert (first.status_code, first.headers["upload-offset"]) == (204, "1000")
    assert "upload-expires" in first.headers
    assert "content-location" not in first.headers
    assert device.offset == 1000
    last = device.patch(1000)
    assert (last.status_code, last.headers["upload-offset"]) == (204, str(len(device.content)))
    by_tus = gateway.client.get(last.headers["content-location"]).json()
    assert by_tus == device.image()
    assert by_tus["verdict"] == "accepted"
    assert (by_tus["name"], by_tus["prior"]["yaw_deg"]) == ("DSC_1.jpg", 10.5)
    assert gateway.client.get(f"{last.headers['content-location']}/content").content == device.content
    assert bytes_on_disk(gateway) == 0

    other = gateway.scene()
    by_put = gateway.put(other, device.content, name="DSC_1.jpg", yaw_deg="10.5").json()
    for one in (by_put, by_tus):
        one.pop("scene_id")
        one.pop("received_at")
    assert by_put == by_tus


def test_a_client_that_missed_the_last_response_learns_that_all_has_arrived(device: Device) -> None:
    device.create()
    device.patch(0)
    size = len(device.content)
    assert device.offset == size
    assert device.create().headers["upload-offset"] == str(size)
    nothing = device.patch(size)  # what tuspy sends then
    assert (nothing.status_code, nothing.headers["upload-offset"]) == (204, str(size))
    assert device.patch(0).status_code == 409


def test_an_image_that_the_scene_has_needs_no_bytes(gateway: Any, device: Device) -> None:
    gateway.put(device.scene, device.content)
    made = device.create()
    assert (made.status_code, made.headers["upload-offset"]) == (201, str(len(device.content)))
    assert made.headers["content-location"].endswith(sha256_of(device.content))
    assert device.offset == len(device.content)
    assert bytes_on_disk(gateway) == 0
    wrong = Device(gateway.client, device.scene, device.content)
    headers = {**VERSION, "Upload-Length": "7", "Upload-Metadata": made.request.headers["upload-metadata"]}
    assert wrong.client.post("/v1/uploads", headers=headers).status_code == 422


def test_an_upload_that_is_created_again_goes_on(device: Device) -> None:
    device.create(name="a.jpg")
    url = device.url
    device.patch(0, 700)
    again = device.create(name="b.jpg")
    assert (again.status_code, again.headers["location"], again.headers["upload-offset"]) == (201, url, "700")
    device.patch(700)
    assert device.image()["name"] == "b.jpg"


def test_a_creation_may_carry_the_first_bytes(gateway: Any, device: Device) -> None:
    made = device.create(device.content[:500])
    assert (made.status_code, made.headers["upload-offset"]) == (201, "500")
    again = device.create(device.content[:900])
    assert again.headers["upload-offset"] == "500", "they begin at 0, where the upload does not go on"
    device.delete()
    whole = device.create(device.content)
    assert (whole.status_code, whole.headers["upload-offset"]) == (201, str(len(device.content)))
    assert gateway.client.get(whole.headers["content-location"]).json()["verdict"] == "accepted"
    wrong = Device(gateway.client, device.scene, b"abc")
    headers = {**VERSION, "Upload-Length": "3", "Content-Type": "image/jpeg"}
    headers["Upload-Metadata"] = tus_metadata(scene=device.scene, sha256=sha256_of(b"abc"))
    assert wrong.client.post("/v1/uploads", headers=headers, content=b"abc").status_code == 415
    more = wrong.client.post("/v1/uploads", headers={**headers, **TYPE}, content=b"abcd")
    assert more.status_code == 413
    assert len(descriptions(gateway)) == 1, "of the image that is stored"


def test_a_chunk_that_does_not_begin_at_the_offset_is_refused(device: Device) -> None:
    device.create()
    device.patch(0, 100)
    for offset in (0, 99, 101):
        answer = device.patch(offset, offset + 10)
        assert (answer.status_code, answer.json()["code"]) == (409, "offset-mismatch")
    assert device.offset == 100


@pytest.mark.parametrize("offset", [None, "", "-1", "1.5", "x", "1e3", "9" * 30])
def test_an_offset_is_a_number(device: Device, offset: str | None) -> None:
    device.create()
    headers = {**device.headers, **TYPE, **({} if offset is None else {"Upload-Offset": offset})}
    answer = device.client.patch(device.url, headers=headers, content=b"x")
    assert (answer.status_code, answer.json()["code"]) == (400, "malformed-request")


@pytest.mark.parametrize("kind", [None, "application/octet-stream", "image/jpeg"])
def test_the_type_of_a_chunk_is_that_of_the_protocol(device: Device, kind: str | None) -> None:
    device.create()
    headers = {**device.headers, "Upload-Offset": "0", **({} if kind is None else {"Content-Type": kind})}
    assert device.client.patch(device.url, headers=headers, content=b"x").status_code == 415
    assert device.offset == 0


@pytest.mark.parametrize("algorithm", ["sha1", "sha256"])
def test_of_a_chunk_with_another_checksum_nothing_is_kept(
    gateway: Any, device: Device, algorithm: str
) -> None:
    device.create()
    assert device.patch(0, 1000, checksum(algorithm, device.content[:1000])).status_code == 204
    wrong = device.patch(1000, 2000, checksum(algorithm, b"damaged"))
    assert (wrong.status_code, wrong.json()["code"]) == (460, "checksum-mismatch")
    assert wrong.json()["retryable"]
    assert device.offset == bytes_on_disk(gateway) == 1000
    assert device.patch(1000, None, checksum(algorithm, device.content[1000:])).status_code == 204
    assert device.image()["verdict"] == "accepted"


@pytest.mark.parametrize("given", ["md5 1B2M2Y8AsgTpgAmY7PhCfg==", "sha256", "sha256 ????", "sha1 AAAA", ""])
def test_checksums_that_cannot_be_checked_are_refused(device: Device, given: str) -> None:
    device.create()
    answer = device.patch(0, 10, {"Upload-Checksum": given})
    assert (answer.status_code, answer.json()["code"]) == (400, "malformed-request")
    assert device.offset == 0


def test_a_damaged_image_is_not_stored_and_its_upload_begins_anew(gateway: Any, device: Device) -> None:
    right, device.content = device.content, device.content
    device.create()
    device.patch(0, 100)
    device.content = right[:100] + b"x" + right[101:]
    wrong = device.patch(100)
    assert (wrong.status_code, wrong.json()["code"]) == (422, "digest-mismatch")
    assert wrong.headers["content-type"] == "application/problem+json"
    assert device.head().status_code == 404
    assert bytes_on_disk(gateway) == 0
    device.content = right
    assert device.create().headers["upload-offset"] == "0"
    assert device.patch(0).status_code == 204


def test_bytes_beyond_the_end_are_refused(gateway: Any, device: Device) -> None:
    device.create()
    device.patch(0, 100)
    device.content += b"more"
    assert device.patch(100).status_code == 413

    def chunks() -> Iterator[bytes]:  # without a declared length
        yield device.content[100:]

    headers = {**device.headers, **TYPE, "Upload-Offset": "100"}
    assert device.client.patch(device.url, headers=headers, content=chunks()).status_code == 413
    assert device.offset == bytes_on_disk(gateway) == 100


def test_a_deleted_upload_is_gone(gateway: Any, device: Device) -> None:
    device.create(device.content[:100])
    assert bytes_on_disk(gateway) == 100
    deleted = device.delete()
    assert (deleted.status_code, deleted.headers["tus-resumable"]) == (204, "1.0.0")
    assert bytes_on_disk(gateway) == 0
    assert not descriptions(gateway)
    for answer in (device.head(), device.patch(0), device.delete()):
        assert answer.status_code == 404


@pytest.mark.parametrize("version", [None, "0.2.2", "2.0.0"])
def test_other_versions_of_the_protocol_are_refused(device: Device, version: str | None) -> None:
    device.create()
    device.headers = {} if version is None else {"Tus-Resumable": version}
    for answer in (device.create(), device.head(), device.patch(0, 10), device.delete()):
        assert (answer.status_code, answer.headers["tus-version"]) == (412, "1.0.0")
    assert device.client.head("/v1/uploads/upl_unknown", headers=device.headers).status_code == 412
    device.headers = dict(VERSION)
    assert device.offset == 0


def test_a_post_may_stand_for_another_method(device: Device) -> None:
    device.create()

    def post(method: str, content: bytes = b"", **headers: str) -> httpx2.Response:
        sent = {**VERSION, "X-HTTP-Method-Override": method, **TYPE, **headers}
        return device.client.post(device.url, headers=sent, content=content)

    assert post("PATCH", device.content[:10], **{"Upload-Offset": "0"}).headers["upload-offset"] == "10"
    assert post("HEAD").headers["upload-offset"] == "10"
    assert post("DELETE").status_code == 204
    assert device.head().status_code == 404
    images = f"/v1/scenes/{device.scene}/images/sha256:{'0' * 64}"
    assert device.client.post(images, headers={"X-HTTP-Method-Override": "DELETE"}).status_code == 405
