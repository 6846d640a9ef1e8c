"""Views of a dataset in the frame of a scene's model."""

from collections import Counter
from collections.abc import Iterable, Mapping

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import PinholeCamera, SimilarityTransform
from fvs_engine.geometry.alignment.dataset import DatasetAlignment, align_dataset, same_frame
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.scene import Scene
from fvs_engine.views import PinholeView

_ALIGNMENT_HINT = (
    "Check that the poses belong to these photographs and which axes they use; `--poses known` takes them as "
    "they are."
)


def align(scene: Scene) -> DatasetAlignment:
    """Align the scene's dataset with its model; raises ``InvalidInputError`` when they disagree."""
    if scene.settings.poses == "known":
        return same_frame(len(scene.views))
    try:
        return align_dataset(
            [scene.dataset.by_name[view.name].camera_from_model.inverse() for view in scene.views],
            [view.camera_from_model.inverse() for view in scene.views],
        )
    except InvalidInputError as error:
        raise InvalidInputError(error.message, hint=_ALIGNMENT_HINT) from error


def expected_views(
    scene: Scene, names: Iterable[str], alignment: DatasetAlignment
) -> tuple[PinholeView, ...]:
    """The views of the scene's dataset in the model frame, as they are expected to be registered."""
    cameras = {name: scene.expected_camera(name) for name in names}
    return comparable_views(scene.dataset, cameras, alignment.model_from_world)


def comparable_views(
    dataset: Dataset, cameras: Mapping[str, PinholeCamera], model_from_world: SimilarityTransform
) -> tuple[PinholeView, ...]:
    """Views of the dataset (name → camera) in the model frame.

    Scores of different image sizes cannot be compared, so views of other image sizes get the most frequent
    camera.
    """
    if not cameras:
        return ()
    (size, _), *_ = Counter((camera.width, camera.height) for camera in cameras.values()).most_common()
    fitting = [camera for camera in cameras.values() if (camera.width, camera.height) == size]
    (usual, _), *_ = Counter(fitting).most_common()
    candidates = []
    for name, camera in cameras.items():
        world_from_camera = dataset.by_name[name].camera_from_model.inverse()
        model_from_camera = model_from_world.move_camera(world_from_camera)
        comparable = camera if (camera.width, camera.height) == size else usual
        candidates.append(PinholeView(name, comparable, model_from_camera.inverse()))
    return tuple(candidates)
