from pathlib import Path

import pytest
from fvs_service.host.runner.scene_choice import choose, read_choice
from fvs_service.host.runner.scene_folder import SceneFolder
from fvs_service.settings import WorkerSettings

from fvs_engine.errors import InvalidInputError
from fvs_engine.sfm.settings import SfmSettings
from fvs_schema.jobs import JobKind, JobRequest

UPDATE = JobRequest(kind=JobKind.UPDATE)


def test_the_first_update_chooses_for_all(tmp_path: Path) -> None:
    folder, settings = SceneFolder(tmp_path), WorkerSettings()
    with pytest.raises(FileNotFoundError):
        read_choice(folder)
    first = choose(folder, UPDATE.model_copy(update={"long_side_px": 320}), settings, 5)
    later = choose(folder, UPDATE, settings.model_copy(update={"initial_iterations": 7}), 50)
    assert first == later == read_choice(folder)
    assert first.long_side_px == 320
    with pytest.raises(InvalidInputError, match="long_side_px to 320"):
        choose(folder, UPDATE.model_copy(update={"long_side_px": 640}), settings, 50)


@pytest.mark.parametrize(("images", "many"), [(19, False), (20, True)])
def test_a_scene_that_begins_with_many_images_has_the_features_of_a_large_set(
    tmp_path: Path, images: int, many: bool
) -> None:
    sfm = choose(SceneFolder(tmp_path), UPDATE, WorkerSettings(), images).settings(None, None).sfm
    usual = SfmSettings()
    assert sfm.features(5) == (usual.features_of_many if many else usual.features_of_few)
    assert sfm.features(50) == usual.features_of_many


@pytest.mark.parametrize(("requested", "images"), [(300, 11), (300, 24), (5, 11), (2_000, 30)])
def test_the_first_full_model_has_the_requested_iterations(
    tmp_path: Path, requested: int, images: int
) -> None:
    request = UPDATE.model_copy(update={"iterations": requested})
    made = choose(SceneFolder(tmp_path), request, WorkerSettings(), images)
    settings = made.settings(None, None)
    assert settings.iterations_of("full", images) == requested
    assert requested <= settings.iterations_of("full", 2 * images) <= 2 * requested
