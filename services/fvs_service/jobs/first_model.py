"""The first model: a quick model of ten images, with which the first update of many images begins."""

from collections.abc import Mapping

FIRST_MODEL = "first model"
"""Its stage: all that an update of these images alone would do, up to a quick model."""
FIRST_IMAGES = 10
"""Its images: the fewest that usually make a model that ranks."""

PARTS: Mapping[str, tuple[float, float]] = {
    "features": (0.0, 0.4),
    "matching": (0.4, 0.5),
    "incremental mapping": (0.5, 0.65),
    "evidence": (0.65, 0.7),
    "global mapping": (0.7, 0.7),
    "load": (0.7, 0.75),
    "quick training": (0.75, 1.0),
}
"""The stages that it consists of: the part of the whole, from and to, that each one is.

Global mapping runs only where the first mapper's model leaves doubt.
"""


def has_first_model(*, first: bool, images: int) -> bool:
    """Whether an update has one: the ``first`` of a scene, of at least twice as many images."""
    return first and images >= 2 * FIRST_IMAGES
