"""Views of a dataset as candidates in the model frame, and the PSNR of a registered view."""

from collections import Counter
from collections.abc import Mapping

from fvs_engine.geometry import PinholeCamera, SimilarityTransform
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.scene import Scene
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.splat.metrics import psnr
from fvs_engine.splat.render import render_color
from fvs_engine.views import PinholeView


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


def psnr_of(scene: Scene, model: SceneModel, name: str) -> float | None:
    """The PSNR of a registered view's photograph, rendered by ``model``; None where it is unregistered."""
    for view in scene.views:
        if view.name == name:
            render = render_color(model.gaussians, view, scene.rasterizer, sh_degree=model.sh_degree)
            return psnr(render, view.image / 255.0)
    return None
