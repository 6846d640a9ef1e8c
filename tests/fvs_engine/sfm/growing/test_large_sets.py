"""Sets that become large: their images get other features than the first ones did."""

import shutil
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from fvs_engine.geometry import umeyama
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.monitor import Monitor
from fvs_engine.sfm.batch.reconstruct import reconstruct
from fvs_engine.sfm.colmap.database import feature_counts
from fvs_engine.sfm.colmap.transforms_json import import_transforms_json
from fvs_engine.sfm.growing.reconstruction import GrowingReconstruction
from fvs_engine.sfm.native import registration
from fvs_engine.sfm.native.match_cache import load_all
from fvs_engine.sfm.pose_priors import ImageSet
from fvs_engine.sfm.settings import FeatureSettings, SfmSettings

NAMES = [f"{i:04d}.jpg" for i in range(9)]
SETTINGS = SfmSettings(
    threads=1,
    exhaustive_up_to=5,
    features_of_few=FeatureSettings(max_image_size_px=270),
    features_of_many=FeatureSettings(),
)
pytestmark = pytest.mark.process


def grow(folder: Path, images: Path) -> GrowingReconstruction:
    return GrowingReconstruction.open(folder, images, SETTINGS, Monitor())


def errors(yard_dir: Path, centres: dict[str, np.ndarray]) -> np.ndarray:
    """Shares of the spread by which centres are off, after the alignment."""
    views = import_transforms_json(yard_dir / "transforms.json").views
    true = {Path(view.name).name: view.centre for view in views}
    ours, theirs = (np.stack([found[name] for name in centres]) for found in (centres, true))
    return np.linalg.norm(umeyama(ours, theirs).apply(ours) - theirs, axis=1) / centre_spread(theirs)


@pytest.mark.system
def test_a_set_that_becomes_large_keeps_its_features_and_is_localised_in_by_those_of_its_images(
    yard_dir: Path, tmp_path: Path
) -> None:
    images, first, more, others = yard_dir / "images", NAMES[2:6], [NAMES[6], NAMES[1]], [NAMES[7], NAMES[0]]
    growing = grow(tmp_path, images)
    growing.add(first, Monitor())
    growing.localise([more[0]], Monitor())
    as_a_guest = feature_counts(tmp_path / "localise" / "database.db")[more[0]]
    few = feature_counts(tmp_path / "sfm" / "database.db")
    growing.add(more, Monitor())
    counts = feature_counts(tmp_path / "sfm" / "database.db")
    assert {name: counts[name] for name in first} == few
    assert counts[more[0]] != as_a_guest
    assert set(growing.registered) == {*first, *more}

    # Their neighbours among the registered images are those of ``more``.
    found = growing.localise(others, Monitor())
    shutil.rmtree(tmp_path / "localise")
    again = growing.localise(others, Monitor())
    assert found.keys() == again.keys()
    for name, view in found.items():
        assert np.array_equal(view.camera_from_model.matrix, again[name].camera_from_model.matrix)


@pytest.mark.system
def test_a_folder_whose_set_has_become_large_or_small_is_reconstructed_with_other_features(
    yard_dir: Path, tmp_path: Path
) -> None:
    images, database = yard_dir / "images", tmp_path / "database.db"
    counts = []
    for count in (5, 6, 5):
        reconstruct(ImageSet(images, NAMES[:count]), tmp_path, SETTINGS, Monitor())
        counts.append(feature_counts(database)[NAMES[0]])
    assert counts[1] != counts[0]
    assert counts[2] == counts[0]


@pytest.mark.system
@pytest.mark.usefixtures("native_here")
def test_an_image_is_registered_by_the_matches_around_it_as_by_all(
    yard_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    images, loaded = yard_dir / "images", []

    def load(database: Path, names: set[str], model: pycolmap.Reconstruction) -> object:
        loaded.append(len(names))
        return load_all(database, names, model)

    centres = []
    for whole in (False, True):
        with monkeypatch.context() as patched:
            patched.setattr(registration, "load_all", load)
            if whole:
                patched.setattr(
                    registration,
                    "load_around",
                    lambda database, names, _new, model: load_all(database, names, model),
                )
            growing = grow(tmp_path / str(whole), images)
            growing.add(NAMES[:5], Monitor())
            growing.add([NAMES[5]], Monitor())
            centres.append(growing.reconstruction.centres())
            assert set(centres[-1]) == set(NAMES[:6])
    # Six images are more than a tenth above five: both ended in a global adjustment, with all matches.
    assert loaded == [6, 6]
    for found in centres:
        assert errors(yard_dir, found).max() < 0.03
