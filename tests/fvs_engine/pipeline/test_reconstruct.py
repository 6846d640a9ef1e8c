"""Photographs that EXIF turns or masks hide, with and without given cameras: up to normalised copies."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fvs_engine.errors import Cancelled
from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.images.masks import read_mask
from fvs_engine.monitor import Monitor, Progress
from fvs_engine.pipeline.manifest import ReconstructionSettings
from fvs_engine.pipeline.reconstruct import reconstruct_folder
from fvs_engine.pipeline.workspace import Workspace
from fvs_engine.sfm.colmap.model import write_colmap
from fvs_engine.sfm.reconstruction import Reconstruction
from fvs_engine.views import View
from fvs_schema.findings import Finding, FindingCode
from fvs_schema.stages import Stage

NAMES = ("a.png", "b.png")


def normalised(
    photographs: Path, out: Path, colmap: Path | None = None, transforms: Path | None = None
) -> list[Finding]:
    """Reconstruct until the photographs are normalised; the findings."""
    findings: list[Finding] = []

    def stop(progress: Progress) -> None:
        if progress.stage is Stage.NORMALISE and progress.done == progress.total:
            monitor.cancel()

    monitor = Monitor(on_progress=stop, on_warning=findings.append)
    settings = ReconstructionSettings(
        colmap=str(colmap) if colmap else None, transforms=str(transforms) if transforms else None
    )
    with pytest.raises(Cancelled):
        reconstruct_folder(photographs, out, settings, monitor=monitor)
    return findings


def model(folder: Path, width: int, height: int) -> Path:
    camera = PinholeCamera(width, height, 60.0, 60.0, width / 2, height / 2)
    poses = (RigidTransform(np.eye(3), np.array([x, 0.0, 0.0])) for x in (0.0, 1.0))
    write_colmap(Reconstruction.of_views(map(View, NAMES, (camera, camera), poses)), folder)
    return folder


@pytest.mark.parametrize("orientation", [3, 6])
def test_given_cameras_belong_to_stored_pixels_unless_their_shape_says_otherwise(
    orientation: int, tmp_path: Path
):
    photographs, out = tmp_path / "photographs", tmp_path / "out"
    photographs.mkdir()
    exif = Image.Exif()
    exif[0x0112] = orientation
    pixels = np.random.default_rng(0).integers(0, 255, (2, 48, 64, 3), dtype=np.uint8)
    for name, image in zip(NAMES, pixels, strict=True):
        Image.fromarray(image).save(photographs / name, exif=exif)
    upright = np.rot90(pixels[0], 2 if orientation == 3 else -1)

    def result() -> np.ndarray:
        with Image.open(Workspace(out).images / "a.png") as image:
            assert image.getexif().get(0x0112, 1) == 1
            return np.asarray(image)

    assert normalised(photographs, out) == []
    np.testing.assert_array_equal(result(), upright)
    stored = model(tmp_path / "stored", 64, 48)
    (note,) = normalised(photographs, out, stored)  # on top of the upright ones
    assert (note.code, note.images) == (FindingCode.PIXELS_AS_STORED, NAMES)
    np.testing.assert_array_equal(result(), pixels[0])
    manifest = Workspace(out).read_manifest()
    assert manifest is not None
    assert [record.as_stored for record in manifest.images.photographs] == [True, True]
    if orientation == 6:
        assert normalised(photographs, out, model(tmp_path / "upright", 48, 64)) == []
        np.testing.assert_array_equal(result(), upright)


def test_masks_of_a_transforms_json_are_those_of_its_photographs(tmp_path: Path):
    photographs, out, file = tmp_path / "photographs", tmp_path / "out", tmp_path / "transforms.json"
    photographs.mkdir()
    for name, pixels in zip(NAMES, np.random.default_rng(0).integers(0, 255, (2, 48, 64, 3)), strict=True):
        Image.fromarray(pixels.astype(np.uint8)).save(photographs / name)
    mask = Image.new("L", (64, 48), 255)
    mask.paste(0, (0, 0, 20, 48))
    mask.save(tmp_path / "segment.png")
    frames = [{"file_path": f"images/{name}", "transform_matrix": np.eye(4).tolist()} for name in NAMES]
    frames[0]["mask_path"] = "segment.png"
    file.write_text(json.dumps({"w": 64, "h": 48, "fl_x": 60, "frames": frames}))
    (finding,) = normalised(photographs, out, transforms=file)
    assert (finding.code, finding.images) == (FindingCode.WITHOUT_MASK, ("b.png",))
    np.testing.assert_array_equal(read_mask(out / "images", "a.png"), np.asarray(mask) > 0)
    manifest = Workspace(out).read_manifest()
    assert manifest is not None
    digest = hashlib.sha256((tmp_path / "segment.png").read_bytes()).hexdigest()
    assert [record.mask_sha256 for record in manifest.images.photographs] == [digest, None]
