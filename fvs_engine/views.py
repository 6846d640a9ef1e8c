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


AnyView: TypeAlias = View[Camera]
"""A view whose camera may have lens distortion."""

PinholeView: TypeAlias = View[PinholeCamera]
"""A view that can be rendered."""
