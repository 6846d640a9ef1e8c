"""A view: a named camera with its pose. The one type for it in the engine."""

from dataclasses import dataclass
from typing import Generic, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from fvs_engine.geometry import Camera, PinholeCamera, RigidTransform

CameraT_co = TypeVar("CameraT_co", bound=Camera, covariant=True)


@dataclass(frozen=True, eq=False)
class View(Generic[CameraT_co]):
    """A camera and its pose, known by ``name``: that of its image (a posix path) or of a candidate.

    ``camera_from_model`` takes the frame of the model that the view belongs to into camera coordinates; the
    views of a dataset belong to the dataset's own model. Pydantic models may hold views: in JSON the pose is
    its matrix [3, 4].
    """

    name: str
    camera: CameraT_co
    camera_from_model: RigidTransform

    @property
    def centre(self) -> NDArray[np.float64]:
        """The camera's centre [3] in the model frame."""
        return self.camera_from_model.inverse().translation

    @property
    def counted_share(self) -> float:
        """The share of its image that counts; 1 without a mask."""
        return 1.0


AnyView: TypeAlias = View[Camera]
"""A view whose camera may have lens distortion."""

PinholeView: TypeAlias = View[PinholeCamera]
"""A view that can be rendered."""


@dataclass(frozen=True, eq=False)
class MaskedView(View[CameraT_co]):
    """A view of whose image a ``share`` counts; the image and its mask are not here."""

    share: float

    @property
    def counted_share(self) -> float:
        """See ``View``."""
        return self.share


def with_share(view: View[CameraT_co], share: float) -> View[CameraT_co]:
    """The view alone, without an image, of which the ``share`` counts."""
    bare = (view.name, view.camera, view.camera_from_model)
    return View(*bare) if share == 1.0 else MaskedView(*bare, share)
