import hashlib
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import anyio
import pytest
from fvs_client import (
    AsyncClient,
    Client,
    ConflictError,
    FvsError,
    ImageMetadata,
    NotFoundError,
    Outcome,
    UnusedMaskError,
    UploadProgress,
    UploadReport,
    Verdict,
)
from fvs_client.cli.app import app
from PIL import Image
from typer.testing import CliRunner
from videos import textured, write_video


def test_a_folder_is_sent_once_and_its_bytes_never_again(
    client: Client, gateway: Any, photographs: Path
) -> None:
    scene = client.scenes.create("quarry")
    seen: list[UploadProgress] = []
    first = scene.images.upload(photographs, on_progress=seen.append)
    assert [file.path.name for file in first.files] == ["a.JPG", "b.jpg", "c.png"]
    assert {file.outcome for file in first.files} == {Outcome.SENT}
    assert [file.image.name for file in first.files if file.image] == ["a.JPG", "b.jpg", "left_c.png"]
    size = sum(file.path.stat().st_size for file in first.files)
    assert first.ok
    assert first.bytes_sent == size
    assert (seen[-1].files_done, seen[-1].bytes_done, seen[-1].bytes_total) == (3, size, size)
    assert [step.bytes_done for step in seen] == sorted(step.bytes_done for step in seen)

    before = _received_bytes(gateway)
    again = scene.images.upload(photographs, on_progress=seen.append)
    assert [file.outcome for file in again.already_there] == [Outcome.ALREADY_THERE] * 3
    assert again.bytes_sent == 0
    assert seen[-1].bytes_done == size
    assert [file.image for file in again.files] == [file.image for file in first.files]
    assert _received_bytes(gateway) - before < 1_000
    assert scene.refresh().image_counts.received == 3


def test_verdicts_of_many_known_images_come_from_the_list(
    client: Client, tmp_path: Path, photograph: Callable[..., bytes]
) -> None:
    scene = client.scenes.create("quarry")
    for number in range(12):
        (tmp_path / f"{number:02d}.jpg").write_bytes(photograph(number))
    first = scene.images.upload(tmp_path)
    again = scene.images.upload(tmp_path)
    assert len(again.already_there) == 12
    assert [file.image for file in again.files] == [file.image for file in first.files]


def test_the_async_client_sends_several_at_a_time(
    url: str, photographs: Path, photograph: Callable[..., bytes]
) -> None:
    for number in range(9):
        (photographs / f"{number}.jpg").write_bytes(photograph(100 + number))
    seen: list[UploadProgress] = []
    threads: set[int] = set()

    def on_progress(progress: UploadProgress) -> None:
        seen.append(progress)
        threads.add(threading.get_ident())

    async def main() -> tuple[UploadReport, UploadReport]:
        async with AsyncClient(url) as client:
            scene = await client.scenes.create("quarry")
            first = await scene.images.upload(photographs, parallel=4, on_progress=on_progress)
            return first, await scene.images.upload(photographs)

    first, again = anyio.run(main)
    assert (len(first.sent), first.ok, len(again.already_there), again.bytes_sent) == (12, True, 12, 0)
    assert (seen[-1].files_done, seen[-1].bytes_done) == (12, first.bytes_sent)
    assert threads == {threading.get_ident()}
    assert [file.image for file in again.files] == [file.image for file in first.files]


def test_an_async_upload_that_fails_for_all_raises_the_one_error(url: str, photographs: Path) -> None:
    async def main() -> None:
        async with AsyncClient(url) as client:
            scene = await client.scenes.create("quarry")
            await scene.model_copy(update={"id": "scn_none"}).images.upload(photographs)

    with pytest.raises(NotFoundError):
        anyio.run(main)


def test_each_file_has_its_verdict_and_a_bad_one_does_not_stop_the_rest(
    client: Client, tmp_path: Path, photograph: Callable[..., bytes]
) -> None:
    scene = client.scenes.create("quarry")
    (tmp_path / "good.jpg").write_bytes(photograph(1))
    (tmp_path / "twin.jpg").write_bytes(photograph(1))
    (tmp_path / "torn.jpg").write_bytes(photograph(2)[:300])
    (tmp_path / "locked.jpg").symlink_to(tmp_path / "nowhere.jpg")
    (tmp_path / "empty.jpg").write_bytes(b"")
    paths = [tmp_path / f"{name}.jpg" for name in ("torn", "good", "twin", "empty")]
    report = scene.images.upload([*paths])
    verdicts = {file.path.stem: file.image.verdict for file in report.files if file.image is not None}
    assert verdicts["torn"] == Verdict.UNREADABLE
    assert verdicts["good"] == verdicts["twin"] == Verdict.ACCEPTED
    assert {file.path.stem: file.outcome for file in report.files}["twin"] is Outcome.ALREADY_THERE
    assert {file.path.stem for file in report.rejected} | {file.path.stem for file in report.failed} == {
        "torn",
        "empty",
    }
    assert not report.ok
    with pytest.raises(FileNotFoundError, match="locked"):
        scene.images.upload(tmp_path / "locked.jpg")


def test_a_file_that_vanishes_is_reported(
    client: Client, tmp_path: Path, photograph: Callable[..., bytes]
) -> None:
    scene = client.scenes.create("quarry")
    for number in range(3):
        (tmp_path / f"{number}.jpg").write_bytes(photograph(number))

    def remove(progress: UploadProgress) -> None:
        if progress.files_done == 0 and progress.bytes_done == 0:
            (tmp_path / "1.jpg").unlink(missing_ok=True)

    report = scene.images.upload(tmp_path, on_progress=remove, parallel=1)
    assert [file.outcome for file in report.files] == [Outcome.SENT, Outcome.FAILED, Outcome.SENT]
    assert isinstance(report.failed[0].error, FileNotFoundError)


def test_a_file_that_is_too_large_fails_alone(
    serve: Callable[..., Any], tmp_path: Path, photograph: Callable[..., bytes]
) -> None:
    small, large = photograph(1, size=(40, 40)), photograph(2, size=(400, 400))
    gateway = serve(limits={"image_bytes": len(small)})
    (tmp_path / "large.jpg").write_bytes(large)
    (tmp_path / "small.jpg").write_bytes(small)
    with Client(str(gateway.client.base_url)) as client:
        report = client.scenes.create("quarry").images.upload(tmp_path)
    assert [file.outcome for file in report.files] == [Outcome.FAILED, Outcome.SENT]
    error = report.failed[0].error
    assert isinstance(error, FvsError)
    assert error.request_id


def test_what_fails_for_every_file_raises(client: Client, photographs: Path) -> None:
    scene = client.scenes.create("quarry")
    elsewhere = scene.model_copy(update={"id": "scn_none"})
    with pytest.raises(NotFoundError):
        elsewhere.images.upload(photographs)


def test_files_can_be_described(client: Client, photographs: Path) -> None:
    scene = client.scenes.create("quarry")

    def describe(path: Path) -> ImageMetadata | None:
        if path.name != "b.jpg":
            return None
        return ImageMetadata(latitude_deg=48.25, longitude_deg=7.5, altitude_m=412.0, yaw_deg=-90.0)

    report = scene.images.upload(photographs, describe=describe)
    priors = {file.path.name: file.image.prior for file in report.files if file.image}
    assert priors["a.JPG"] is None
    assert priors["b.jpg"] is not None
    assert (priors["b.jpg"].latitude_deg, priors["b.jpg"].yaw_deg) == (48.25, -90.0)
    assert report.files[1].image is not None
    assert report.files[1].image.name == "b.jpg"


def test_one_image_can_be_sent_from_memory(client: Client, photograph: Callable[..., bytes]) -> None:
    scene = client.scenes.create("quarry")
    content = photograph(7)
    digest = f"sha256:{hashlib.sha256(content).hexdigest()}"
    assert scene.images.check([digest]).missing == (digest,)
    image = scene.images.put(content, ImageMetadata(name="last.jpg"))
    assert (image.digest, image.name, image.accepted) == (digest, "last.jpg", True)
    assert scene.images.check([digest]).known == (digest,)
    assert scene.images.get(digest) == image
    assert list(scene.images.list()) == [image]


def test_formats_that_are_not_read_are_named_and_not_sent(client: Client, photographs: Path) -> None:
    (photographs / "IMG_1.HEIC").write_bytes(b"as phones write it")
    scene = client.scenes.create("quarry")
    seen: list[UploadProgress] = []
    report = scene.images.upload(photographs, on_progress=seen.append)
    sent = sum(file.path.stat().st_size for file in report.sent)
    assert sent == report.bytes_sent
    assert [file.path.name for file in report.failed] == ["IMG_1.HEIC"]
    assert "HEIC" in str(report.failed[0].error)
    assert (len(report.sent), report.ok) == (3, False)
    assert (seen[-1].files_done, seen[-1].bytes_done) == (4, seen[-1].bytes_total)
    assert len(list(scene.images.list())) == 3
    (named,) = scene.images.upload(photographs / "IMG_1.HEIC").rejected  # a file that is named is sent
    assert named.image is not None
    assert named.image.verdict is Verdict.UNREADABLE


def test_a_key_that_may_only_send_gets_no_verdicts_of_known_images(
    serve: Callable[..., Any], photographs: Path
) -> None:
    from fvs_service.principal import Scope

    gateway = serve(require_keys=True)
    with Client(
        str(gateway.client.base_url), gateway.key("t").popitem()[1].removeprefix("Bearer ")
    ) as client:
        scene = client.scenes.create("quarry")
    key = gateway.key("t", scopes=frozenset({Scope.UPLOAD}))["Authorization"].removeprefix("Bearer ")
    with Client(str(gateway.client.base_url), key) as device:
        images = device.scenes.images(scene.id)
        assert all(file.image is not None for file in images.upload(photographs).files)
        again = images.upload(photographs)
    assert [file.image for file in again.already_there] == [None] * 3
    command = ["--url", str(gateway.client.base_url), "--api-key", key, "upload", scene.id, str(photographs)]
    assert CliRunner().invoke(app, command).stdout == "0 sent (0.0 MB), 3 there already\n"


def _received_bytes(gateway: Any) -> float:
    return sum(
        sample.value
        for family in gateway.app.state.metrics.received_bytes.collect()
        for sample in family.samples
        if sample.name.endswith("_total")
    )


def test_masks_are_sent_after_their_images(client: Client, photographs: Path) -> None:
    with Image.open(photographs / "a.JPG") as image:
        size = image.size
    whole, half = Image.new("L", size, 255), Image.new("L", size, 255)
    half.paste(0, (0, 0, size[0] // 2, size[1]))
    (photographs / "masks").mkdir()
    half.save(photographs / "masks" / "a.png")
    whole.resize((8, 8)).save(photographs / "masks" / "b.jpg.png")
    scene = client.scenes.create("quarry")
    for outcome in (Outcome.SENT, Outcome.ALREADY_THERE):
        report = scene.images.upload(photographs)
        assert [file.outcome for file in report.files] == [outcome] * 3
        assert [file.path.name for file in report.without_mask] == ["b.jpg"]
        assert "8×8 px" in str(report.without_mask[0].mask_error)
        assert report.without_mask[0].usable
        assert (report.ok, report.failed) == (False, ())
        masked = {file.path.name for file in report.files if file.image and file.image.mask}
        assert masked == {"a.JPG"}
    (image,) = (image for image in scene.images.list() if image.mask)
    assert image.name == "a.JPG"
    assert scene.images.remove_mask(image.digest).mask is None


def test_a_mask_that_the_scene_has_is_not_sent_again(
    client: Client, gateway: Any, photographs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (photographs / "masks").mkdir()
    mask = photographs / "masks" / "a.png"
    with Image.open(photographs / "a.JPG") as image:
        half = Image.new("L", image.size, 255)
    half.paste(0, (0, 0, 9, 9))
    half.save(mask)
    scene = client.scenes.create("quarry")
    digest = scene.images.upload(photographs).files[0].digest
    assert digest is not None
    (checked,) = scene.images.check([digest]).images
    assert checked.mask == f"sha256:{hashlib.sha256(mask.read_bytes()).hexdigest()}"
    set_mask, sent = gateway.application.masks.set, []
    monkeypatch.setattr(
        gateway.application.masks, "set", lambda *given: (sent.append(given), set_mask(*given))[1]
    )
    assert scene.images.upload(photographs).ok
    assert not sent
    half.putpixel((20, 20), 0)
    half.save(mask)
    assert scene.images.upload(photographs).ok
    assert len(sent) == 1


def test_masks_of_no_image_are_reported(client: Client, url: str, photographs: Path) -> None:
    (photographs / "masks").mkdir()
    for name in ("a", "c"):  # that of left/c.png would be masks/left/c.png
        Image.new("L", (96, 64), 255).save(photographs / "masks" / f"{name}.png")
    Image.new("L", (9, 9), 255).save(photographs / "masks" / "b.png")
    scene = client.scenes.create("quarry")
    report = scene.images.upload(photographs)
    (failed,) = report.failed
    assert (failed.path, len(report.sent)) == (photographs / "masks" / "c.png", 3)
    assert isinstance(failed.error, UnusedMaskError)
    assert failed.error.hint
    answer = CliRunner().invoke(app, ["--url", url, "upload", scene.id, str(photographs)])
    assert "masks/c.png: failed: It is in a folder of masks, and the mask of no image." in answer.stderr
    assert answer.stdout == "0 sent (0.0 MB), 3 there already, 1 without their mask, 1 failed\n"
    assert answer.stderr.count("b.jpg: already there without its mask: The mask of b.jpg cannot be used") == 1
    nothing = CliRunner().invoke(
        app, ["--url", url, "upload", scene.id, str(photographs / "masks" / "c.png")]
    )
    assert nothing.exit_code == 0, "a file that is named is sent"


def test_masks_of_images_that_are_not_used_are_not_sent(client: Client, photographs: Path) -> None:
    (photographs / "masks").mkdir()
    for name in ("twin", "text"):
        Image.new("L", (8, 8)).save(photographs / "masks" / f"{name}.png")
    (photographs / "twin.jpg").write_bytes((photographs / "a.JPG").read_bytes() + b"\0")
    (photographs / "text.jpg").write_text("no image")
    scene = client.scenes.create("quarry")
    scene.images.upload(photographs / "a.JPG")
    for _ in range(2):
        report = scene.images.upload(photographs)
        assert not report.failed
        verdicts = {file.path.name: file.image.verdict.value for file in report.files if file.image}
        assert (verdicts["twin.jpg"], verdicts["text.jpg"]) == ("duplicate", "unreadable")


def test_a_video_is_sent_after_its_subtitles(client: Client, tmp_path: Path) -> None:
    video = write_video(tmp_path / "DJI_0001.MP4", [(float(n), textured(seed=n)) for n in range(2)])
    (tmp_path / "DJI_0001.SRT").write_text(
        "1\n00:00:00,000 --> 00:00:01,000\n[latitude: 47] [longitude: 8]\n"
    )
    images = client.scenes.create("quarry").images
    for outcome in (Outcome.SENT, Outcome.ALREADY_THERE):
        report = images.upload(tmp_path, describe=lambda _path: ImageMetadata(every_s=0.5))
        assert [(file.path, file.outcome) for file in report.files] == [(video, outcome)]
        assert report.ok
        assert report.files[0].image is not None
        assert (report.files[0].image.verdict, report.files[0].image.every_s) == (Verdict.VIDEO, 0.5)
    with pytest.raises(ConflictError, match="has the video already"):
        images.set_subtitles(report.files[0].digest or "", b"1")
