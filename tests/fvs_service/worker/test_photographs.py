import io
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from fvs_service.ids import new_id
from fvs_service.images.model import Image as SceneImage
from fvs_service.images.model import Registration, Verdict
from fvs_service.images.service import blob_key
from fvs_service.model import now
from fvs_service.scenes.model import CameraPrior
from fvs_service.storage.blobs import Blobs
from fvs_service.worker.runner.photographs import place_photographs
from PIL import Image

from fvs_engine.images.focal import focal_length_px
from fvs_engine.monitor import Monitor

_ORIENTATION, _MAKE = 0x0112, 0x010F


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


def test_photographs_are_upright_files_in_the_order_of_arrival(
    tmp_path: Path, store: Callable[..., SceneImage]
) -> None:
    images = [store(2), store(10, "WEBP"), store(1, exif={_ORIENTATION: 6}), store(3, "PNG")]
    blobs, folder = Blobs(tmp_path / "blobs"), tmp_path / "scene" / "images"
    placed = place_photographs(blobs, images, folder, None, Monitor())
    assert [placed[name].number for name in sorted(placed)] == [1, 2, 3, 10]
    with Image.open(folder / min(placed)) as turned:
        assert turned.size == (48, 64)
    before = {file.name: file.stat().st_mtime_ns for file in folder.iterdir()}
    again = place_photographs(blobs, [*images, store(11)], folder, None, Monitor())
    assert len(again) == 5
    assert before.items() <= {file.name: file.stat().st_mtime_ns for file in folder.iterdir()}.items()


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "TIFF"])
def test_what_the_scene_knows_of_its_camera_is_told_to_images_that_do_not(
    tmp_path: Path, store: Callable[..., SceneImage], kind: str
) -> None:
    blobs, folder = Blobs(tmp_path / "blobs"), tmp_path / "scene" / "images"
    silent, labelled = store(1, kind), store(2, kind, exif={_MAKE: "Maker"})
    prior = CameraPrior(focal_length_px=2000.0, width_px=1600)
    stored = blobs.read(blob_key("scn", silent.digest))
    for name in place_photographs(blobs, [silent, labelled], folder, prior, Monitor()):
        with Image.open(folder / name) as image:
            told = focal_length_px(image.getexif(), *image.size)
            assert told == pytest.approx(80.0, rel=0.02)
            expected = np.asarray(Image.open(io.BytesIO(blobs.read(blob_key("scn", _digest(name))))))
            np.testing.assert_array_equal(np.asarray(image), expected)
            if name.startswith("000002"):
                assert image.getexif()[_MAKE] == "Maker"
    assert blobs.read(blob_key("scn", silent.digest)) == stored


def _digest(name: str) -> str:
    return f"sha256:{int(name.split('-')[0]):064x}"


@pytest.mark.parametrize("kind", ["JPEG", "PNG"])
def test_structure_from_motion_begins_with_what_it_was_told(
    tmp_path: Path, store: Callable[..., SceneImage], kind: str
) -> None:
    """COLMAP reads EXIF itself. It is asked in a process of its own, for it clashes with Pillow's zlib."""
    blobs, folder = Blobs(tmp_path / "blobs"), tmp_path / "scene" / "images"
    prior = CameraPrior(focal_length_px=2000.0, width_px=1600)
    (name,) = place_photographs(blobs, [store(1, kind)], folder, prior, Monitor())
    ask = (
        "import pycolmap, sys; camera = pycolmap.infer_camera_from_image(sys.argv[1]); "
        "print(camera.params[0], camera.has_prior_focal_length)"
    )
    told = subprocess.run(
        [sys.executable, "-c", ask, str(folder / name)], capture_output=True, text=True, check=True
    ).stdout.split()
    assert float(told[0]) == pytest.approx(80.0, rel=0.02)
    assert told[1] == "True"
