"""Images that do not belong to the scene, or are of another camera."""

from pathlib import Path

import numpy as np
import pytest
from growing_yard import AGREEMENT, FIRST, NAMES, NEVER, SETTINGS, Grown, copy_of, shares_apart, strangers
from PIL import Image

from fvs_engine.errors import ReconstructionError
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.growing.reconstruction import GrowingReconstruction
from fvs_engine.sfm.reconstruction import Reconstruction
from fvs_schema.findings import Finding, FindingCode


@pytest.fixture
def misleading(images_copy: Path) -> list[str]:
    """A collage, and a photograph of another place, among the photographs."""
    # Half of the matches of a collage say that it was taken here, half that it was taken there.
    with Image.open(images_copy / NAMES[0]) as image:
        collage = image.convert("RGB")
    with Image.open(images_copy / NAMES[2]) as image:
        collage.paste(image.crop((160, 0, 320, 240)), (160, 0))
    collage.save(images_copy / "collage.jpg", quality=95)
    return ["collage.jpg", *strangers(images_copy, 1)]


@pytest.mark.system
@pytest.mark.usefixtures("native_here")
def test_strangers_and_collages_are_not_registered(
    grown: Grown, images_copy: Path, misleading: list[str], tmp_path: Path
):
    growing = GrowingReconstruction.open(
        copy_of(grown.bootstrapped, tmp_path), images_copy, SETTINGS, Monitor()
    )
    update = growing.add(misleading, Monitor())
    assert update.registered == ()
    assert update.unregistered == tuple(misleading)
    collage, stranger = update.warnings
    assert (collage.code, collage.images) == (FindingCode.POSE_UNSUPPORTED, ("collage.jpg",))
    assert stranger == Finding.of(FindingCode.UNMATCHED, ["stranger-0.jpg"])
    why = growing.why_unregistered
    assert why.keys() == set(misleading)
    assert why == {"collage.jpg": collage, "stranger-0.jpg": stranger}
    assert growing.generation == 1


@pytest.mark.slow
def test_strangers_and_collages_are_not_localised(
    grown: Grown, images_copy: Path, misleading: list[str], tmp_path: Path
):
    growing = GrowingReconstruction.open(copy_of(grown.folder, tmp_path), images_copy, SETTINGS, Monitor())
    assert growing.localise(misleading, Monitor()) == {}


@pytest.mark.slow
def test_an_image_of_another_camera_is_registered_too(
    grown: Grown, images_copy: Path, truth: Reconstruction, tmp_path: Path
):
    with Image.open(images_copy / NEVER) as image:
        image.convert("RGB").resize((288, 216)).save(images_copy / NEVER, quality=95)
    growing = GrowingReconstruction.open(copy_of(grown.folder, tmp_path), images_copy, SETTINGS, Monitor())
    (guest,) = growing.localise([NEVER], Monitor()).values()
    assert growing.add([NEVER], Monitor()).registered == (NEVER,)
    added = growing.reconstruction.views[-1]
    assert (guest.camera.width, added.camera.width) == (288, 288)
    # One image alone says less of its focal length, and so of its distance, than many of one camera.
    spread = centre_spread(np.stack(list(grown.last.centres().values())))
    assert shares_apart(growing.reconstruction, truth).max() < 2 * AGREEMENT
    assert np.linalg.norm(guest.centre - added.centre) < 5 * AGREEMENT * spread


@pytest.mark.system
@pytest.mark.usefixtures("native_here")
def test_first_images_that_do_not_overlap_support_no_model(tmp_path: Path):
    names = strangers(tmp_path, 3)
    growing = GrowingReconstruction.open(tmp_path / "growing", tmp_path, SETTINGS, Monitor())
    assert growing.add(names[:1], Monitor()).unregistered == (names[0],)
    with pytest.raises(ReconstructionError, match="3 images") as caught:
        growing.add(names, Monitor())
    assert "overlap" in caught.value.hint
    assert growing.registered == ()
    assert growing.unregistered == tuple(names)
    assert growing.why_unregistered == {}  # they wait for the next update
    assert growing.reconstruction.views == ()
    assert growing.localise(names[:1], Monitor()) == {}


@pytest.mark.slow
def test_first_images_without_a_model_are_tried_again_with_better_ones(images_copy: Path, tmp_path: Path):
    names = strangers(images_copy, 3)
    growing = GrowingReconstruction.open(tmp_path / "growing", images_copy, SETTINGS, Monitor())
    with pytest.raises(ReconstructionError):
        growing.add(names, Monitor())
    update = growing.add(FIRST, Monitor())
    assert update.registered == tuple(FIRST)
    assert update.unregistered == tuple(names)
