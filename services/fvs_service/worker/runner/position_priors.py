"""Position priors of images for structure from motion."""

from collections.abc import Mapping

from fvs_engine.sfm.pose_priors import PosePrior, PosePriors
from fvs_engine.sfm.verification.positions import GPS_ACCURACY_M
from fvs_service.images.model import Image, PriorSource
from fvs_service.scenes.model import Origin
from fvs_service.snapshots.georeferencing import world_position


def position_priors(images: Mapping[str, Image], origin: Origin | None) -> PosePriors | None:
    """The position priors of ``images`` (by file name) in the world frame with this ``origin``.

    None when no request gave one: structure from motion reads the positions in the files itself.
    """
    found = {
        name: (image.prior, position)
        for name, image in images.items()
        if image.prior is not None and (position := world_position(image.prior, origin)) is not None
    }
    if not any(prior.source is PriorSource.REQUEST for prior, _ in found.values()):
        return None
    accuracy_m = GPS_ACCURACY_M if any(prior.geodetic for prior, _ in found.values()) else 0.0
    return PosePriors(
        by_name={name: PosePrior.at(position, accuracy_m) for name, (_, position) in found.items()}
    )
