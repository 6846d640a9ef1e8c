"""Rigid and similarity transforms between named frames.

A variable's name gives the frames that it joins: ``world_from_camera`` takes camera coordinates to
world coordinates. Composition reads like a chain: ``a_from_b @ b_from_c`` is ``a_from_c``.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic_core import CoreSchema, core_schema

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.validation import (
    finite_array,
    rotation_matrices,
    rotation_matrix,
)
from fvs_schema.quantities import MAX_COORDINATE

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RigidTransform:
    """x ↦ R x + t, with ``rotation`` R [3, 3] and ``translation`` t [3], float64.

    Raises ``InvalidInputError`` when R is not a rotation, and for numbers that are not finite or beyond
    ``MAX_COORDINATE``.
    """

    rotation: Array
    translation: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", rotation_matrix("rotation", self.rotation))
        translation = finite_array("translation", self.translation, (3,))
        if max(map(abs, translation.tolist())) > MAX_COORDINATE:
            raise _too_far("translation")
        object.__setattr__(self, "translation", translation)

    @classmethod
    def __get_pydantic_core_schema__(cls, _source: Any, _handler: Any) -> CoreSchema:
        """In pydantic models: the transform itself or its matrix [3, 4]; in JSON the matrix."""
        row = core_schema.list_schema(core_schema.float_schema(), min_length=4, max_length=4)
        rows = core_schema.list_schema(row, min_length=3, max_length=3)
        from_rows = core_schema.no_info_after_validator_function(_from_rows, rows)
        return core_schema.json_or_python_schema(
            json_schema=from_rows,
            python_schema=core_schema.union_schema([core_schema.is_instance_schema(cls), from_rows]),
            serialization=core_schema.plain_serializer_function_ser_schema(
                lambda transform: transform.matrix[:3].tolist()
            ),
        )

    @staticmethod
    def identity() -> "RigidTransform":
        """The transform that changes nothing."""
        return RigidTransform(np.eye(3), np.zeros(3))

    @staticmethod
    def many(rotations: ArrayLike, translations: ArrayLike) -> tuple["RigidTransform", ...]:
        """The transforms of rotations [N, 3, 3] and translations [N, 3].

        They are checked together, which takes a tenth of the time.
        """
        checked = rotation_matrices("rotations", rotations)
        moved = finite_array("translations", translations, (len(checked), 3))
        if np.abs(moved).max(initial=0.0) > MAX_COORDINATE:
            raise _too_far("translations")
        return tuple(map(RigidTransform._of_checked, checked, moved))

    @staticmethod
    def _of_checked(rotation: Array, translation: Array) -> "RigidTransform":
        transform = object.__new__(RigidTransform)
        object.__setattr__(transform, "rotation", rotation)
        object.__setattr__(transform, "translation", translation)
        return transform

    @staticmethod
    def from_matrix(matrix: ArrayLike) -> "RigidTransform":
        """From a homogeneous matrix [4, 4] or its upper part [3, 4]."""
        values = np.asarray(matrix, dtype=np.float64)
        if values.shape not in {(4, 4), (3, 4)}:
            raise InvalidInputError(f"A transform is a matrix [4, 4] or [3, 4], not {list(values.shape)}.")
        if values.shape == (4, 4) and not np.array_equal(values[3], [0.0, 0.0, 0.0, 1.0]):
            raise InvalidInputError("The last row of a rigid transform's matrix must be 0 0 0 1.")
        return RigidTransform(values[:3, :3], values[:3, 3])

    @property
    def matrix(self) -> Array:
        """The homogeneous matrix [4, 4]."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.rotation, self.translation
        return matrix

    def apply(self, points: ArrayLike) -> Array:
        """Transform points [..., 3]."""
        return np.asarray(points, dtype=np.float64) @ self.rotation.T + self.translation

    def inverse(self) -> "RigidTransform":
        """The transform back."""
        return RigidTransform(self.rotation.T, -self.rotation.T @ self.translation)

    def __matmul__(self, other: "RigidTransform") -> "RigidTransform":
        return RigidTransform(
            self.rotation @ other.rotation, self.rotation @ other.translation + self.translation
        )


def _too_far(name: str) -> InvalidInputError:
    return InvalidInputError(f"{name} has a coordinate beyond {MAX_COORDINATE:g}.")


def _from_rows(rows: list[list[float]]) -> RigidTransform:
    try:
        return RigidTransform.from_matrix(rows)
    except InvalidInputError as error:
        raise ValueError(str(error)) from error


@dataclass(frozen=True, eq=False)
class SimilarityTransform:
    """x ↦ s R x + t, with ``scale`` s > 0, ``rotation`` R [3, 3], ``translation`` t [3], float64.

    Raises ``InvalidInputError`` when s is not positive, R is not a rotation or a number is not finite.
    """

    scale: float
    rotation: Array
    translation: Array

    def __post_init__(self) -> None:
        if not (math.isfinite(self.scale) and self.scale > 0):
            raise InvalidInputError(f"A similarity's scale must be positive and finite, not {self.scale}.")
        object.__setattr__(self, "rotation", rotation_matrix("rotation", self.rotation))
        object.__setattr__(self, "translation", finite_array("translation", self.translation, (3,)))

    @staticmethod
    def identity() -> "SimilarityTransform":
        """The transform that changes nothing."""
        return SimilarityTransform(1.0, np.eye(3), np.zeros(3))

    def apply(self, points: ArrayLike) -> Array:
        """Transform points [..., 3]."""
        rotated = np.asarray(points, dtype=np.float64) @ self.rotation.T
        return self.scale * rotated + self.translation

    def inverse(self) -> "SimilarityTransform":
        """The transform back."""
        scale = 1.0 / self.scale
        return SimilarityTransform(scale, self.rotation.T, -scale * (self.rotation.T @ self.translation))

    def __matmul__(self, other: "SimilarityTransform") -> "SimilarityTransform":
        return SimilarityTransform(
            self.scale * other.scale,
            self.rotation @ other.rotation,
            self.scale * (self.rotation @ other.translation) + self.translation,
        )

    def move_camera(self, source_from_camera: RigidTransform) -> RigidTransform:
        """Take a camera's ``source_from_camera`` into the target frame (cameras do not scale)."""
        return RigidTransform(
            self.rotation @ source_from_camera.rotation, self.apply(source_from_camera.translation)
        )
