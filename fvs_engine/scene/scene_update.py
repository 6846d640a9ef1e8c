"""What adding images to a growing scene has changed."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class SceneUpdate:
    """What one ``add`` changed.

    ``registered``: images that have a pose now and had none before; ``unregistered``: all visited images
    without one; ``moved``: number of views whose camera or pose changed; ``seconds``: for the poses, and for
    loading the images.
    """

    registered: tuple[str, ...]
    unregistered: tuple[str, ...]
    moved: int
    warnings: tuple[str, ...]
    seconds: Mapping[str, float]
