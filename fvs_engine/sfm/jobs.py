"""The native jobs: a request for each, and what the job answers.

A ``Request`` travels to the SfM child as JSON, the answer back; ``native`` has the functions that work.
A job writes either into the database, in transactions, so that a repeated one resumes; or into a folder or
file beside the final one, which the caller renames when the job is done.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

from pydantic import TypeAdapter

from fvs_engine.records import Record
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_schema.findings import Finding

Report = Callable[[int], None]
"""How a job reports its progress: called with the number of items that are done."""

Answer = TypeVar("Answer")


class Request(Record, Generic[Answer]):
    """Base of the requests; ``job`` is the job's name, ``Answer`` the type of its answer.

    ``threads`` is the number of threads, None for one per core.
    """

    job: ClassVar[str]

    @classmethod
    def read(cls, answer: object) -> Answer:
        """The answer from its JSON document."""
        bases = (base for base in cls.__mro__ if issubclass(base, Request))
        (kind,) = next(found for base in bases if (found := base.__pydantic_generic_metadata__["args"]))
        read: Answer = TypeAdapter(kind).validate_python(answer)
        return read


class ImagesRequest(Request[Answer], Generic[Answer]):
    """Base of the requests about images: ``names`` of files in ``image_dir`` that ``database`` describes."""

    database: Path
    image_dir: Path
    names: tuple[str, ...]


class ImportImages(ImagesRequest[None]):
    """Write images of one camera into the database."""

    job = "import_images"
    model: str
    """COLMAP's name of the camera model."""

    params: str
    """Its parameters, separated by commas; without any COLMAP takes EXIF or its default."""

    camera_id: int
    """The camera in the database that took them; −1 adds a new one."""


class ExtractFeatures(ImagesRequest[None]):
    """Extract SIFT features of images; those that have them are skipped."""

    job = "extract"
    max_image_size_px: int
    upsampled: bool
    """Whether images are upsampled twofold."""

    max_features: int
    mask_dir: Path | None
    """The folder of their masks, which all of them have, as COLMAP names them; None: they have none."""

    threads: int | None


class MatchPairs(Request[None]):
    """Match and verify pairs of images, with one thread in each of several processes.

    After ``batch`` pairs in each process the results are written into ``database``; until then they are in
    databases in ``parts_dir``.
    """

    job = "match"
    database: Path
    parts_dir: Path
    pair_list: Path
    """A file with the image ids of a pair in each line."""

    batch: int
    seed: int
    threads: int | None
    """The number of processes."""


class CalibrateViewGraph(Request[bool]):
    """Calibrate the view graph of ``names`` in a copy of the database without other images.

    Answers whether that succeeded.
    """

    job = "calibrate"
    database: Path
    target: Path
    names: tuple[str, ...]
    seed: int


class AdjustingRequest(ImagesRequest[Answer], Generic[Answer]):
    """Base of the requests for models of images, which bundle adjustment refines."""

    out_dir: Path
    refine: bool
    """Whether intrinsics are refined."""

    lens: bool
    """Whether principal points and second radial coefficients are estimated, see ``RobustAdjustment``."""

    seed: int
    threads: int | None


class MapImages(AdjustingRequest[None]):
    """Base of mapping: models go to ``out_dir``/0, 1, …, each adjusted robustly at the end."""


class MapIncrementally(MapImages):
    """Incremental mapping; reports the number of registered images."""

    job = "map_incremental"


class MapGlobally(MapImages):
    """Global mapping (GLOMAP)."""

    job = "map_global"


class TriangulatePoints(Request[int]):
    """Triangulate points for the poses of ``model_dir``, which do not change; answers their number."""

    job = "triangulate"
    database: Path
    image_dir: Path
    model_dir: Path
    out_dir: Path
    threads: int | None


class UndistortImages(Request[None]):
    """Write a pinhole model to ``out_dir``/sparse, and the undistorted ``names`` to ``out_dir``/images.

    Their undistorted masks go to ``out_dir``/masks.
    """

    job = "undistort"
    model_dir: Path
    image_dir: Path
    out_dir: Path
    names: tuple[str, ...]
    jpeg_quality: int


class Registration(Record):
    """Which images got a pose in an existing model, and what is doubtful about it."""

    registered: tuple[str, ...]
    """Newly registered images, in the order of registration."""

    loose: tuple[str, ...]
    """Those of them that only few matches connect with the rest of the model."""

    unscaled: tuple[str, ...]
    """Those of them whose distance to their neighbours nothing confirms."""

    conflicting: tuple[tuple[str, str], ...]
    """Pairs with a new image that should show the same, by their poses, and do not."""

    posed: tuple[str, ...]
    """All images that have a pose afterwards."""

    rejected: dict[str, Finding]
    """Images whose pose was rejected → the reason."""

    adjusted_images: int
    adjusted_points: int
    """The model's size at its last global bundle adjustment."""

    match_support: float | None
    """Share of the verified matches that the model explains; None without a global bundle adjustment."""


class RegisterImages(AdjustingRequest[Registration]):
    """Register ``names`` in the model as far as possible; writes the new model to ``out_dir``."""

    job = "register"
    model_dir: Path
    priors: PosePriors
    min_image_support: float
    """Minimum share of an image's matches that its pose explains."""

    adjust_every: float
    """Growth of the number of images or points, as a share, after which all are adjusted."""

    adjusted_images: int
    adjusted_points: int
    """The model's size at its last global bundle adjustment."""

    two_view_points: bool = False
    """Whether points that only two images show are triangulated, too."""


class GuidedRegistration(Record):
    """Registration by guided matches; ``registration`` is None when no guided pose can be believed."""

    looked_at: tuple[str, ...]
    """Images that were matched, or cannot be: their number per call is limited."""

    registration: Registration | None


class RegisterGuided(Request[GuidedRegistration]):
    """Register images as ``registration`` does, with pairs that pose priors guide.

    Points in only two images are used, too, which ordinary registration leaves out: at the border of a model
    there are hardly any others. Pairs of images that are not registered then are taken back.
    """

    job = "register_guided"
    registration: RegisterImages
    neighbours: dict[str, tuple[str, ...]]
    """Unregistered images → the registered ones that they should overlap."""

    tried: tuple[str, ...]
    """Images that were looked at before, the most recent one last."""


class PairVeto(Record):
    """The result of a veto of verified pairs, and what it shows about the pose priors."""

    believed: bool
    """Whether the priors agree with the model; if not, nothing was vetoed."""

    oriented: bool
    """False when orientation priors contradict position priors."""

    informative: bool
    """Whether the positions are accurate enough to judge the poses of other images."""

    contradicted_support: float | None = None
    """Share of the pairs in the model that fit priors which the model contradicts; None when unknown."""

    without: tuple[str, ...] = ()
    """Images that no chain of verified pairs joins with the model any more."""


class VetoPairs(Request[PairVeto]):
    """Veto pairs of ``names``, images that are not in the model, which ``priors`` contradict."""

    job = "veto"
    database: Path
    model_dir: Path
    names: tuple[str, ...]
    priors: PosePriors


class CopyFeatures(Request[None]):
    """Copy keypoints and descriptors of images that both databases name; those that have them are skipped."""

    job = "copy_features"
    source: Path
    target: Path
    names: tuple[str, ...]


class LocalisedImage(Record):
    """Camera and pose of an image that is not added to the model."""

    model: str
    """COLMAP's name of the camera model."""

    width: int
    height: int
    params: tuple[float, ...]
    camera_from_model: tuple[tuple[float, ...], ...]
    """[3, 4]."""


class Localisation(Record):
    """The images that could be localised, by name."""

    images: dict[str, LocalisedImage]


class LocaliseImages(Request[Localisation]):
    """Estimate the poses of images from their matches in a model, which does not change."""

    job = "localise"
    database: Path
    model_dir: Path
    neighbours: dict[str, tuple[str, ...]]
    """Images → those in the model that they are matched with."""

    siblings: dict[str, str]
    """Images → one in the model that was taken with the same camera; the focal length of the others is
    estimated.
    """

    priors: PosePriors
    min_image_support: float
    """Minimum share of an image's matches that its pose explains."""

    seed: int


class FindTwoViewPoints(Request[None]):
    """Triangulate the points that only two images of ``model_dir`` show.

    Writes ``xyz`` [P, 3] and ``seen_in`` [P], the name of one of the two images, to ``target`` (npz).
    """

    job = "two_view_points"
    database: Path
    model_dir: Path
    target: Path


REQUESTS: dict[str, type[Request[Any]]] = {
    request.job: request
    for request in (
        ImportImages,
        ExtractFeatures,
        MatchPairs,
        CalibrateViewGraph,
        MapIncrementally,
        MapGlobally,
        TriangulatePoints,
        UndistortImages,
        RegisterImages,
        RegisterGuided,
        VetoPairs,
        CopyFeatures,
        LocaliseImages,
        FindTwoViewPoints,
    )
}
"""The request of each job."""
