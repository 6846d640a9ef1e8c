"""Results of native jobs, which the SfM child returns as JSON."""

from fvs_engine.records import Record


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
    """All images with a pose now."""

    rejected: dict[str, str]
    """Images whose pose was rejected → the reason."""

    adjusted_images: int
    adjusted_points: int
    """The model's size at its last global bundle adjustment."""

    match_support: float | None
    """Share of the verified matches that the model explains; None without a global bundle adjustment."""


class GuidedRegistration(Record):
    """Registration by guided matches; ``registration`` is None when no guided pose can be believed."""

    looked_at: tuple[str, ...]
    """Images that were matched, or cannot be: their number per call is limited."""

    registration: Registration | None


class PairVeto(Record):
    """What a veto of verified pairs found out about the pose priors."""

    believed: bool
    """Whether the priors agree with the model; else nothing was vetoed."""

    oriented: bool
    """False when orientation priors contradict position priors."""

    informative: bool
    """Whether the positions can judge the poses of other images."""

    contradicted_support: float | None = None
    """The support of priors that the model contradicts by the pairs in it; None when it is unknown."""

    without: tuple[str, ...] = ()
    """Images that no chain of verified pairs joins with the model any more."""


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
