"""Settings of reconstruction and training that a scene's first update chooses for all later ones."""

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.atomic import write_text_atomically
from fvs_engine.records import Record
from fvs_engine.scene.settings import SCENE_TRAINING, SceneSettings
from fvs_engine.sfm.settings import FocalPrior, SfmSettings
from fvs_schema.jobs import JobRequest
from fvs_schema.scenes import CameraPrior
from fvs_service.host.runner.scene_folder import SceneFolder
from fvs_service.jobs.stages import has_first_model
from fvs_service.settings import WorkerSettings


class SceneChoice(Record):
    """The choice of a scene's first update."""

    long_side_px: int
    initial_iterations: int
    iterations_per_image: int
    max_gaussians: int
    many_images: bool
    """Whether it began with many images: then the first ones have the features of a large set, too."""

    def settings(self, camera: CameraPrior | None, threads: int | None) -> SceneSettings:
        """The settings of the scene."""
        prior = None if camera is None else FocalPrior.model_validate(camera.model_dump())
        sfm = SfmSettings(threads=threads, focal_prior=prior)
        if self.many_images:
            sfm = sfm.model_copy(update={"features_of_few": sfm.features_of_many})
        return SceneSettings(
            long_side_px=self.long_side_px,
            initial_iterations=self.initial_iterations,
            iterations_per_view=self.iterations_per_image,
            warm_starts=True,
            training=SCENE_TRAINING.model_copy(update={"max_gaussians": self.max_gaussians}),
            sfm=sfm,
        )


def choose(folder: SceneFolder, request: JobRequest, settings: WorkerSettings, images: int) -> SceneChoice:
    """The choice of the scene's first update; this one, of ``images`` ≥ 1, makes it if it is the first.

    Raises ``InvalidInputError`` when a later request wants another one.
    """
    try:
        kept = read_choice(folder)
    except FileNotFoundError:
        kept = SceneChoice(
            long_side_px=request.long_side_px or settings.long_side_px,
            initial_iterations=request.iterations or settings.initial_iterations,
            iterations_per_image=iterations_per_image(request, settings, images),
            max_gaussians=settings.max_gaussians,
            many_images=has_first_model(first=True, images=images),
        )
        write_text_atomically(folder.choice, kept.model_dump_json(indent=1))
    for name, wanted, used in (
        ("long_side_px", request.long_side_px, kept.long_side_px),
        ("iterations", request.iterations, kept.initial_iterations),
    ):
        if wanted is not None and wanted != used:
            raise InvalidInputError(
                f"The scene's first update set {name} to {used}, and the model keeps it.",
                hint=f"Omit {name}. Fine jobs and new scenes can have other values.",
            )
    return kept


def iterations_per_image(request: JobRequest, settings: WorkerSettings, images: int) -> int:
    """The iterations per image of a scene whose first update, of ``images``, is the ``request``.

    No more than give the requested number for these images: only more images get more.
    """
    usual = settings.iterations_per_image
    return usual if request.iterations is None else min(usual, request.iterations // images)


def read_choice(folder: SceneFolder) -> SceneChoice:
    """The choice of the scene's first update; raises ``FileNotFoundError`` before it."""
    return SceneChoice.model_validate_json(folder.choice.read_text(encoding="utf-8"))
