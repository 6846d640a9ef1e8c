"""The changes that adding images made to a growing scene."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class SceneUpdate:
    """The result of one ``add``.

    ``registered``: images that have a pose now and had none before; ``unregistered``: all visited images
    without one; ``moved``: number of views whose camera or pose changed; ``seconds``: for the poses, and for
    loading the images.
    """

    registered: tuple[str, ...]
    unregistered: tuple[str, ...]
    moved: int
    warnings: tuple[str, ...]
    seconds: Mapping[str, float]
