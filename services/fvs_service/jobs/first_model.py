"""The model of a scene's first images, with which a first update of many images begins."""

FIRST_MODEL = "first model"
"""Its stage: all that an update of these images alone would do, up to a quick model."""
FIRST_IMAGES = 10
"""Its images: the fewest that usually make a model that ranks."""


def has_first_model(*, first: bool, images: int) -> bool:
    """Whether an update has one: the ``first`` of a scene, of at least twice as many images."""
    return first and images >= 2 * FIRST_IMAGES
