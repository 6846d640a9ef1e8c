"""From a mark in a stored photograph to a sight of the model."""

import numpy as np

from fvs_engine.control.triangulation import Sight
from fvs_engine.errors import InvalidInputError
from fvs_engine.images.pixels import LAST_OF_SAME_SIDES, upright_pixel
from fvs_engine.views import AnyView
from fvs_schema.control_points import Mark


def sight_of(point: str, mark: Mark, view: AnyView, orientation: int) -> Sight:
    """The sight of the point named ``point`` by its ``mark`` in the photograph of ``view``.

    ``orientation``: how the stored pixels were turned for the view. Raises ``InvalidInputError`` for a mark
    outside the photograph.
    """
    size = view.camera.width, view.camera.height
    width, height = size if orientation <= LAST_OF_SAME_SIDES else size[::-1]
    if mark.x_px > width or mark.y_px > height:
        raise InvalidInputError(
            f"The mark of {point} in {mark.image} is at {mark.x_px:g}, {mark.y_px:g} px; the photograph has "
            f"{width} × {height} px as it is stored.",
            hint="Mark the photographs that were reconstructed, not copies of another size.",
        )
    return Sight(view, upright_pixel(np.array([mark.x_px, mark.y_px]), (width, height), orientation))
