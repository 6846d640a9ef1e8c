"""Where photographs were taken, as their senders told it, for structure from motion."""

from collections.abc import Mapping

from fvs_engine.sfm.verification.positions import GPS_ACCURACY_M, Positions
from fvs_service.images.model import Image, PriorSource
from fvs_service.scenes.model import Origin
from fvs_service.snapshots.georeferencing import place_told


def told_positions(images: Mapping[str, Image], origin: Origin | None) -> Positions | None:
    """The places of ``images`` (file name → image) in the world that has this ``origin``.

    None when no sender told one: what stands in the files alone, structure from motion finds there itself.
    """
    placed = {
        name: (image.prior, place)
        for name, image in images.items()
        if image.prior is not None and (place := place_told(image.prior, origin)) is not None
    }
    if not any(prior.source is PriorSource.REQUEST for prior, _ in placed.values()):
        return None
    accuracy_m = GPS_ACCURACY_M if any(prior.geodetic for prior, _ in placed.values()) else 0.0
    return Positions({name: place for name, (_, place) in placed.items()}, accuracy_m)
