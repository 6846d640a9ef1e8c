import io
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from fvs_service.host.protocol.messages import RunJob
from fvs_service.host.runner.image_files import discard_images, prepare_images
from fvs_service.host.runner.scene_jobs import SceneJobs
from fvs_service.ids import new_id
from fvs_service.images.files import blob_key, notice_of
from fvs_service.settings import WorkerSettings
from fvs_service.storage.blob_keys import mask_key
from fvs_service.storage.blobs import Blobs
from fvs_service.storage.clock import now
from PIL import Image

from fvs_engine.errors import EngineError
from fvs_engine.images.masks import read_mask
from fvs_engine.monitor import Monitor
from fvs_schema.findings import Finding, FindingCode
from fvs_schema.images import Image as SceneImage
from fvs_schema.images import Registration, Verdict
from fvs_schema.jobs import JobKind, JobRequest

_ORIENTATION = 0x0112


@pytest.fixture
def store(tmp_path: Path) -> Callable[..., SceneImage]:
    """Store a photograph as the gateway would have."""
    blobs = Blobs(tmp_path / "blobs")

    def make(number: int, kind: str = "JPEG", exif: dict[int, object] | None = None) -> SceneImage:
        pixels = np.random.default_rng(number).integers(0, 256, (48, 64, 3), dtype=np.uint8)
        tags = Image.Exif()
        for tag, value in (exif or {}).items():
            tags[tag] = value
        out = io.BytesIO()
        Image.fromarray(pixels).save(out, kind, exif=tags)
        digest = f"sha256:{number:064x}"
        blobs.put(out.getvalue(), blob_key("scn", digest))
        return SceneImage(
            digest=digest,
            scene_id="scn",
            number=number,
            name=new_id("img"),
            verdict=Verdict.ACCEPTED,
            reason="",
            hint="",
            warnings=(),
            duplicate_of=None,
            registration=Registration.PENDING,
            size_bytes=len(out.getvalue()),
            format=kind,
            width_px=64,
            height_px=48,
            focal_length_px=None,
            sharpness=1.0,
            prior=None,
            captured_at=None,
            received_at=now(),
        )

    return make


def test_masks_lie_beside_their_images(tmp_path: Path, store: Callable[..., SceneImage]) -> None:
    blobs, folder = Blobs(tmp_path / "blobs"), tmp_path / "scene" / "images"
    counts = np.tile(np.arange(64) < 20, (48, 1))
    out = io.BytesIO()
    Image.fromarray(counts).save(out, "PNG")
    mask = f"sha256:{5:064x}"
    masked = store(1, exif={_ORIENTATION: 6}).model_copy(update={"mask": mask})
    blobs.put(out.getvalue(), mask_key("scn", masked.sha256, mask.removeprefix("sha256:")))
    placed = prepare_images(blobs, [masked, store(2)], folder, Monitor()).files
    assert [read_mask(folder, name) is not None for name in sorted(placed)] == [True, False]
    np.testing.assert_array_equal(read_mask(folder, min(placed)), np.rot90(counts, -1))
    discard_images(folder, [max(placed)])
    assert [path.name for path in folder.iterdir()] == [max(placed)]
    assert not list((tmp_path / "scene" / "masks").iterdir())


def test_photographs_are_upright_files_in_the_order_of_arrival(
    tmp_path: Path, store: Callable[..., SceneImage]
) -> None:
    images = [store(2), store(10, "WEBP"), store(1, exif={_ORIENTATION: 6}), store(3, "PNG")]
    blobs, folder = Blobs(tmp_path / "blobs"), tmp_path / "scene" / "images"
    placed = prepare_images(blobs, images, folder, Monitor()).files
    assert [placed[name].number for name in sorted(placed)] == [1, 2, 3, 10]
    with Image.open(folder / min(placed)) as turned:
        assert turned.size == (48, 64)
    before = {file.name: file.stat().st_mtime_ns for file in folder.iterdir()}
    again = prepare_images(blobs, [*images, store(11)], folder, Monitor()).files
    assert len(again) == 5
    assert before.items() <= {file.name: file.stat().st_mtime_ns for file in folder.iterdir()}.items()


def test_a_number_that_is_given_again_does_not_bring_old_pixels_back(
    tmp_path: Path, store: Callable[..., SceneImage]
) -> None:
    blobs, folder = Blobs(tmp_path / "blobs"), tmp_path / "scene" / "images"
    first, second = store(1), store(2)
    other = second.model_copy(update={"number": 1, "digest": f"sha256:{'ab' * 32}"})
    blobs.put(blobs.read(blob_key("scn", second.digest)), blob_key("scn", other.digest))
    prepare_images(blobs, [first], folder, Monitor())
    placed = prepare_images(blobs, [other], folder, Monitor())
    assert list(placed.files) == ["000001-abababababab.jpg"]
    discard_images(folder, placed.files)
    assert [file.name for file in folder.iterdir()] == ["000001-abababababab.jpg"]


def test_what_was_deleted_meanwhile_is_left_out_and_what_the_engine_rejects_is_named(
    tmp_path: Path, store: Callable[..., SceneImage]
) -> None:
    blobs, folder = Blobs(tmp_path / "blobs"), tmp_path / "scene" / "images"
    images = [store(number) for number in (1, 2, 3)]
    blobs.remove(blob_key("scn", images[1].digest))
    out = io.BytesIO()
    Image.new("L", (32, 900)).save(out, "JPEG")
    blobs.put(out.getvalue(), blob_key("scn", images[2].digest))
    placed = prepare_images(blobs, images, folder, Monitor())
    assert list(placed.files.values()) == images[:1]
    assert list(placed.rejected) == [images[2].digest]
    assert "32×900 px" in placed.rejected[images[2].digest].texts["why"]


@pytest.mark.parametrize("kind", JobKind)
def test_a_job_names_the_images_that_the_engine_rejects(
    tmp_path: Path, store: Callable[..., SceneImage], kind: JobKind
) -> None:
    images = (store(1), store(2))
    told: list[Finding] = []
    quarantined: dict[str, Finding] = {}
    blobs, bad = Blobs(tmp_path / "blobs"), images[1]
    out = io.BytesIO()
    Image.new("L", (32, 900)).save(out, "JPEG")
    blobs.put(out.getvalue(), blob_key("scn", bad.digest))
    nothing = SimpleNamespace()
    jobs = SceneJobs(tmp_path / "scene", blobs, WorkerSettings(), *[cast(Any, nothing)] * 3)
    request = RunJob(
        job_id="job",
        request=JobRequest(kind=kind),
        images=images,
        camera=None,
        origin=None,
        snapshot_id=None,
    )
    with pytest.raises(EngineError):  # one image makes no model
        jobs.run(request, cast(Any, Monitor(on_warning=told.append)), quarantined.update)
    (warning,) = (notice_of(one, images, tmp_path) for one in told)
    assert (warning.code, warning.images) == (FindingCode.UNUSABLE_PHOTOGRAPH, (bad.digest,))
    assert "32×900 px" in warning.message
    assert list(quarantined) == [bad.digest]
