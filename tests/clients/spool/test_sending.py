"""Photographs that a spool sends to a gateway."""

import base64
import hashlib
import json
import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from fvs_client import Client, ConflictError, Verdict
from fvs_client.spool import Outbox, Settings, Spool, connection
from fvs_client.spool.connection import Target
from fvs_client.spool.draining import Drain
from fvs_client.spool.errors import SpoolError
from fvs_client.spool.folder import find_files
from fvs_client.spool.outbox import FILE_NAME
from fvs_client.spool.photograph import State
from fvs_client.spool.taking import take
from PIL import Image as PillowImage
from videos import textured, write_video


class Field:
    """A folder of photographs with its outbox, and a scene to send them to."""

    def __init__(self, folder: Path, url: str, scene: str, key: str | None = None) -> None:
        self.folder, self.url, self.scene, self.key = folder, url, scene, key
        self.outbox = Outbox(folder / FILE_NAME)
        self.said: list[str] = []

    def take(self) -> None:
        for file in find_files(self.folder):
            take(self.outbox, file, self.scene)

    def drain(self, **settings: Any) -> list[State]:
        """Send all that waits; the states afterwards."""
        made = Settings(**{"longest_pause_s": 0.05, "timeout_s": 5.0, **settings})
        drain = Drain(self.outbox, Target(self.url, self.key), made, self.said.append)
        drain.run(threading.Event(), until_empty=True)
        return [photograph.state for photograph in self.outbox.all()]


@pytest.fixture
def folder(tmp_path: Path, photograph: Callable[..., bytes]) -> Path:
    made = tmp_path / "DCIM"
    made.mkdir()
    for number in range(3):
        (made / f"DJI_{number:04d}.JPG").write_bytes(photograph(number))
    return made


@pytest.fixture
def field(folder: Path, url: str, client: Client) -> Iterator[Field]:
    made = Field(folder, url, client.scenes.create("quarry").id)
    yield made
    made.outbox.close()


def test_photographs_arrive_with_their_metadata(field: Field, client: Client) -> None:
    (field.folder / "DJI_0001.json").write_text(
        '{"latitude_deg": 48.1, "longitude_deg": 7.2, "altitude_m": 310.5, "altitude_datum": "ellipsoid", '
        '"yaw_deg": 30, "pitch_deg": -45, "captured_at": "2026-05-01T12:00:00Z"}'
    )
    field.take()
    assert field.drain() == [State.SENT] * 3
    images = list(client.scenes.images(field.scene).list())
    assert [image.name for image in images] == ["DJI_0000.JPG", "DJI_0001.JPG", "DJI_0002.JPG"]
    prior = images[1].prior
    assert prior is not None
    assert (prior.latitude_deg, prior.longitude_deg, prior.altitude_m) == (48.1, 7.2, 310.5)
    assert (prior.altitude_datum, prior.yaw_deg, prior.pitch_deg) == ("ellipsoid", 30, -45)
    assert images[1].captured_at is not None
    assert images[0].prior is None
    assert [photograph.verdict for photograph in field.outbox.all()] == ["accepted"] * 3


def test_a_video_arrives_after_its_subtitles(field: Field, client: Client) -> None:
    write_video(field.folder / "DJI_0003.MP4", [(float(n), textured(seed=n)) for n in range(2)])
    (field.folder / "DJI_0003.SRT").write_text("1\n00:00:00,000 --> 00:00:01,000\n[latitude: 47]\n")
    field.take()
    assert field.drain() == [State.SENT] * 4
    assert [photograph.verdict for photograph in field.outbox.all()] == [*["accepted"] * 3, "video"]
    images = client.scenes.images(field.scene)
    video = list(images.list())[-1]
    with pytest.raises(ConflictError, match="subtitles are read with its frames"):
        images.set_subtitles(video.digest, b"1")


def test_the_newest_goes_first_when_asked_to(field: Field, client: Client) -> None:
    field.take()
    field.drain(newest_first=True)
    images = client.scenes.images(field.scene).list()
    assert [image.name for image in images] == ["DJI_0002.JPG", "DJI_0001.JPG", "DJI_0000.JPG"]


def test_the_newest_comes_between_the_pieces_of_an_older_one(
    field: Field, client: Client, photograph: Callable[..., bytes]
) -> None:
    for file in field.folder.iterdir():
        if file.suffix == ".JPG":
            file.unlink()
    (field.folder / "1.jpg").write_bytes(photograph(1, size=(1_000, 800)))
    field.take()
    draining = threading.Thread(target=_drain_newest_first, args=(field.folder, field.url))
    draining.start()
    _wait_for(lambda: field.outbox.get(1).state is State.SENDING)
    (field.folder / "2.jpg").write_bytes(photograph(2))
    field.take()
    draining.join()
    assert [image.name for image in client.scenes.images(field.scene).list()] == ["2.jpg", "1.jpg"]


def _drain_newest_first(folder: Path, url: str) -> None:
    settings = Settings(newest_first=True, max_rate_bytes_s=600_000)
    with Outbox(folder / FILE_NAME) as outbox:
        Drain(outbox, Target(url, None), settings, lambda _: None).run(threading.Event(), until_empty=True)


def test_a_refused_photograph_is_kept_and_the_next_goes_on(
    field: Field, photograph: Callable[..., bytes]
) -> None:
    (field.folder / "DJI_0000.JPG").write_bytes(photograph(9)[:300] + b"\xff\xd9")
    (field.folder / "DJI_0001.json").write_text('{"x_m": 480, "y_m": 7.2, "z_m": 1}')  # in no local world
    field.take()
    assert field.drain(delete_sent=True) == [State.REFUSED, State.REFUSED, State.SENT]
    unreadable, invalid, _ = field.outbox.all()
    assert unreadable.verdict == Verdict.UNREADABLE
    assert unreadable.refusal is not None
    assert unreadable.refusal.code == "unreadable"
    assert unreadable.refusal.hint
    assert invalid.refusal is not None
    assert invalid.refusal.code == "invalid-request"
    assert "local" in invalid.refusal.reason
    assert sorted(file.name for file in field.folder.glob("*.JPG")) == ["DJI_0000.JPG", "DJI_0001.JPG"]
    assert any("refused" in line for line in field.said)


def test_a_mask_follows_its_photograph(field: Field, client: Client) -> None:
    masks = field.folder / "masks"
    with PillowImage.open(field.folder / "DJI_0000.JPG") as image:
        mask = PillowImage.new("L", image.size, 255)
    mask.putpixel((1, 1), 0)
    masks.mkdir()
    mask.save(masks / "DJI_0000.JPG.png")
    mask.resize((8, 8)).save(masks / "DJI_0001.png")
    field.take()
    assert field.drain() == [State.SENT, State.REFUSED, State.SENT], "and masks are no photographs"
    refusal = field.outbox.all()[1].refusal
    assert refusal is not None
    assert refusal.reason.startswith(
        "The scene has the photograph without its mask. The mask of DJI_0001.JPG"
    )
    assert "8×8 px" in refusal.reason
    images = {image.name: image.mask for image in client.scenes.images(field.scene).list()}
    sent = hashlib.sha256((masks / "DJI_0000.JPG.png").read_bytes()).hexdigest()
    assert images == {"DJI_0000.JPG": f"sha256:{sent}", "DJI_0001.JPG": None, "DJI_0002.JPG": None}


def test_a_mask_that_the_scene_has_is_not_sent_again(
    field: Field, gateway: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    masks = field.folder / "masks"
    masks.mkdir()
    with PillowImage.open(field.folder / "DJI_0000.JPG") as image:
        mask = PillowImage.new("L", image.size, 255)
    mask.putpixel((1, 1), 0)
    mask.save(masks / "DJI_0000.png")
    sent: list[object] = []
    set_mask = gateway.application.masks.set
    monkeypatch.setattr(
        gateway.application.masks, "set", lambda *given: (sent.append(given), set_mask(*given))[1]
    )
    for _ in range(2):  # the second time from an outbox that knows nothing
        field.take()
        assert field.drain() == [State.SENT] * 3
        assert len(sent) == 1
        field.outbox.close()
        for file in field.folder.glob(f"{FILE_NAME}*"):
            file.unlink()
        field.outbox = Outbox(field.folder / FILE_NAME)


def test_photographs_of_a_scene_that_is_not_there_are_kept(field: Field) -> None:
    field.scene = "scn_01m00000000000000000000000"
    field.take()
    assert field.drain() == [State.REFUSED] * 3
    refusal = field.outbox.all()[0].refusal
    assert refusal is not None
    assert refusal.code == "not-found"


def test_what_the_scene_has_is_not_sent_again(field: Field, client: Client) -> None:
    client.scenes.images(field.scene).upload(field.folder)
    twin = field.folder / "DJI_0003.JPG"
    twin.write_bytes((field.folder / "DJI_0000.JPG").read_bytes())
    field.take()
    assert field.drain() == [State.SENT] * 4
    assert len(list(client.scenes.images(field.scene).list())) == 3


def test_only_what_is_acknowledged_is_deleted_and_only_when_asked_to(
    field: Field, photograph: Callable[..., bytes]
) -> None:
    field.take()
    changed, gone = field.folder / "DJI_0000.JPG", field.folder / "DJI_0001.JPG"
    field.drain()
    assert len(list(field.folder.glob("*.JPG"))) == 3
    changed.write_bytes(photograph(77))
    gone.unlink()
    field.drain(delete_sent=True)
    assert [file.name for file in field.folder.glob("*.JPG")] == ["DJI_0000.JPG"]
    assert all(found.deleted for found in field.outbox.all())
    field.take()
    assert field.drain() == [State.SENT] * 4


def test_the_disk_limit_deletes_the_oldest_first(field: Field) -> None:
    field.take()
    newest = (field.folder / "DJI_0002.JPG").stat().st_size
    field.drain(max_disk_bytes=newest)
    assert len(list(field.folder.glob("*.JPG"))) == 3
    assert sum("Nothing is deleted without --delete-sent" in line for line in field.said) == 1
    field.drain(max_disk_bytes=newest, delete_sent=True)
    assert [file.name for file in field.folder.glob("*.JPG")] == ["DJI_0002.JPG"]


def test_a_file_that_changes_or_vanishes_is_refused(field: Field, photograph: Callable[..., bytes]) -> None:
    field.take()
    (field.folder / "DJI_0000.JPG").write_bytes(photograph(50))
    (field.folder / "DJI_0001.JPG").unlink()
    assert field.drain() == [State.REFUSED, State.REFUSED, State.SENT]
    changed, gone, _ = (found.refusal for found in field.outbox.all())
    assert changed is not None
    assert gone is not None
    assert (changed.code, gone.code) == ("file-unreadable", "file-missing")


def test_an_interrupted_photograph_goes_on_where_the_service_has_got_to(field: Field, gateway: Any) -> None:
    field.take()
    first = field.outbox.all()[0]
    content = first.path.read_bytes()
    begun = {"scene": field.scene, "sha256": first.digest}
    metadata = ",".join(
        f"{name} {base64.b64encode(value.encode()).decode()}" for name, value in begun.items()
    )
    headers = {"Tus-Resumable": "1.0.0", "Upload-Length": str(len(content)), "Upload-Metadata": metadata}
    kind = {"Content-Type": "application/offset+octet-stream"}
    created = gateway.client.post("/v1/uploads", headers={**headers, **kind}, content=content[:1_000])
    assert created.headers["upload-offset"] == "1000"
    field.outbox.begin(first.number, None)  # the spool was killed before it knew
    before = _received(gateway)
    assert field.drain() == [State.SENT] * 3
    left = sum(found.size_bytes for found in field.outbox.all()) - 1_000
    questions = 3 * len(json.dumps({"digests": [f"sha256:{first.digest}"]}))  # whether the scene has it
    assert _received(gateway) - before == left + questions


def test_an_upload_that_the_service_has_no_more_begins_anew(field: Field, client: Client) -> None:
    field.take()
    first = field.outbox.all()[0].number
    field.outbox.begin(first, "upl_01m00000000000000000000000")
    field.outbox.confirm(first, 1_000)
    assert field.drain() == [State.SENT] * 3
    assert len(list(client.scenes.images(field.scene).list())) == 3


def test_bytes_that_were_damaged_on_the_way_are_sent_again(
    field: Field, client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    field.take()
    reading, damaged = connection._read, []

    def read(part: connection.Part, start: int, size_bytes: int) -> bytes:
        block = reading(part, start, size_bytes)
        if len(damaged) < 2:
            damaged.append(start)
            return bytes(len(block))
        return block

    monkeypatch.setattr(connection, "_read", read)
    assert field.drain() == [State.SENT] * 3
    assert len(damaged) == 2
    assert any("damaged on the way" in line for line in field.said)
    digests = {image.digest for image in client.scenes.images(field.scene).list() if image.accepted}
    assert digests == {f"sha256:{found.digest}" for found in field.outbox.all()}


def test_the_photographs_of_a_card_that_is_taken_out_wait_for_it(
    field: Field, tmp_path: Path, client: Client
) -> None:
    with Outbox(tmp_path / "elsewhere.sqlite3") as outbox:
        for file in find_files(field.folder):
            take(outbox, file, field.scene)
        away = field.folder.rename(tmp_path / "away")
        threading.Timer(0.5, lambda: away.rename(field.folder)).start()
        settings = Settings(longest_pause_s=0.1)
        drain = Drain(outbox, Target(field.url, None), settings, field.said.append)
        drain.run(threading.Event(), until_empty=True)
        assert [found.state for found in outbox.all()] == [State.SENT] * 3
    assert any("is not there" in line for line in field.said)
    assert len(list(client.scenes.images(field.scene).list())) == 3


def test_a_card_that_is_taken_out_while_it_is_read_refuses_nothing(
    field: Field, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read, away = connection._read, tmp_path / "away"

    def fails(*_: Any) -> bytes:
        monkeypatch.setattr(connection, "_read", read)
        field.folder.rename(away)
        threading.Timer(0.3, lambda: away.rename(field.folder)).start()
        raise connection.UnreadableFileError("Input/output error")

    with Outbox(tmp_path / "elsewhere.sqlite3") as outbox:
        for file in find_files(field.folder):
            take(outbox, file, field.scene)
        monkeypatch.setattr(connection, "_read", fails)
        settings = Settings(longest_pause_s=0.1)
        Drain(outbox, Target(field.url, None), settings, field.said.append).run(
            threading.Event(), until_empty=True
        )
        assert [found.state for found in outbox.all()] == [State.SENT] * 3
    assert any("is not there" in line for line in field.said)


def test_an_outbox_that_is_deleted_meanwhile_is_said_and_sending_goes_on(field: Field) -> None:
    field.take()
    field.outbox.path.unlink()
    assert field.drain() == [State.SENT] * 3
    assert sum("was deleted or replaced" in line for line in field.said) == 1


def test_other_content_that_no_clock_tells_apart_is_refused(field: Field) -> None:
    field.take()
    file = field.folder / "DJI_0000.JPG"
    status, content = file.stat(), bytearray(file.read_bytes())
    content[400] ^= 1
    file.write_bytes(content)
    os.utime(file, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert field.drain() == [State.REFUSED, State.SENT, State.SENT]
    refusal = field.outbox.all()[0].refusal
    assert refusal is not None
    assert "other content" in refusal.reason


def test_a_device_whose_key_may_only_upload_is_acknowledged_and_told_the_verdict(
    serve: Callable[..., Any], folder: Path, photograph: Callable[..., bytes]
) -> None:
    from fvs_service.principal import Scope

    gateway = serve(require_keys=True)
    url = str(gateway.client.base_url)
    with Client(url, gateway.key("t")["Authorization"].removeprefix("Bearer ")) as client:
        scene = client.scenes.create("quarry").id
    key = gateway.key("t", scopes=frozenset({Scope.UPLOAD}))["Authorization"].removeprefix("Bearer ")
    field = Field(folder, url, scene, key)
    field.take()
    assert field.drain() == [State.SENT] * 3
    (folder / "twin.jpg").write_bytes((folder / "DJI_0000.JPG").read_bytes())
    field.take()
    assert field.drain() == [State.SENT] * 4
    assert [found.verdict for found in field.outbox.all()] == ["accepted"] * 4
    # Whole by its end, but no image: the service has its digest and not its bytes.
    broken = folder / "broken.jpg"
    broken.write_bytes(photograph(9)[:300] + b"\xff\xd9")
    field.take()
    field.drain(delete_sent=True)
    *accepted, refused = field.outbox.all()
    assert {found.state for found in accepted} == {State.SENT}
    assert (refused.state, refused.verdict) == (State.REFUSED, "unreadable")
    assert refused.refusal is not None
    assert refused.refusal.hint
    assert list(folder.glob("*.[jJ]*")) == [broken]
    field.outbox.close()


def test_a_key_that_is_not_accepted_refuses_no_photograph(serve: Callable[..., Any], folder: Path) -> None:
    gateway = serve(require_keys=True)
    field = Field(folder, str(gateway.client.base_url), "scn_1", "wrong")
    field.take()
    stop = threading.Event()
    threading.Timer(1.0, stop.set).start()
    drain = Drain(field.outbox, Target(field.url, "wrong"), Settings(), field.said.append)
    drain.run(stop, until_empty=True)
    assert {found.state for found in field.outbox.all()} <= {State.WAITING, State.SENDING}
    trouble = field.outbox.trouble()
    assert trouble is not None
    assert "key" in trouble[0]
    field.outbox.close()


def test_a_spool_watches_and_sends_until_it_is_stopped(
    folder: Path, url: str, client: Client, photograph: Callable[..., bytes]
) -> None:
    scene = client.scenes.create("quarry").id
    settings = Settings(settle_s=0.2, look_every_s=0.05)
    said: list[str] = []
    spool = Spool(folder, scene, url=url, settings=settings, say=said.append)
    running = threading.Thread(target=spool.run)
    running.start()
    try:
        _wait_for(lambda: len(said) == 3)
        with pytest.raises(SpoolError, match="Another process"):
            Spool(folder, scene, url=url).run()
        (folder / "DJI_0003.JPG").write_bytes(photograph(3))
        _wait_for(lambda: len(said) == 4)
    finally:
        spool.stop()
        running.join(10)
    assert not running.is_alive()
    assert len(list(client.scenes.images(scene).list())) == 4


def _received(gateway: Any) -> float:
    return sum(
        float(sample.value)
        for family in gateway.app.state.metrics.received_bytes.collect()
        for sample in family.samples
        if sample.name.endswith("_total")
    )


def _wait_for(condition: Callable[[], bool]) -> None:
    waited = threading.Event()
    for _ in range(400):
        if condition():
            return
        waited.wait(0.05)
    raise AssertionError
