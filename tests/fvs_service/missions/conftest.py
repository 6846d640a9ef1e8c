"""Random views at places where coordinates are awkward, and how far parsed ones are from them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import hypothesis
import numpy as np
import pymap3d
import pytest
from fvs_service.missions.writing import write_mission
from fvs_service.scenes.poses import WorldFrame

from fvs_engine.geometry import matrix_from_quaternion, quaternion_from_matrix
from fvs_engine.geometry.geodetic import camera_at
from fvs_schema.missions import MissionOptions, MissionView
from fvs_schema.poses import FramePose, VehiclePose
from fvs_schema.scenes import Alignment, AlignmentStatus, AltitudeDatum, Origin

PLACES = {
    "equator": (0.0, 9.45),
    "north": (70.0, 25.7),
    "antimeridian": (-16.8, 179.9999),
    "just west of the antimeridian": (52.1, -179.9999),
    "alps": (46.02, 7.75),
    "south": (-54.8, -68.3),
}


@dataclass(frozen=True)
class Flight:
    """A random ranking's views, in a georeferenced world, and options to fly them."""

    frame: WorldFrame
    origin: Origin
    views: tuple[MissionView, ...]
    options: dict[str, object]

    def write(self, **options: object) -> bytes:
        """The file in a format."""
        wanted = MissionOptions.model_validate({**self.options, **options})
        return write_mission("flight", self.frame, self.views, (), wanted, None).content

    @property
    def to_takeoff_m(self) -> float:
        """What to add to the scene's altitudes for heights above home."""
        return -float(self.options["home_altitude_m"])  # type: ignore[arg-type]


@dataclass
class Errors:
    """The largest distance and angle between views and what a parser read."""

    metres: float = 0.0
    degrees: float = 0.0

    def add(
        self, flight: Flight, view: MissionView, place: Sequence[float], yaw_deg: float, pitch_deg: float
    ) -> None:
        """Compare a view with a latitude, longitude, altitude (the scene's) and an attitude."""
        pose, origin = view.pose, flight.origin
        if isinstance(pose, FramePose):
            wanted = np.array(pose.position)
            forward = matrix_from_quaternion(pose.orientation_wxyz)[:, 2]
        else:
            wanted = np.array(_enu((pose.latitude_deg, pose.longitude_deg, pose.altitude_m), origin))
            forward = _forward(pose.yaw_deg, pose.pitch_deg)
        found = np.array(_enu(place, origin))
        self.metres = max(self.metres, float(np.linalg.norm(found - wanted)))
        seen = _forward(yaw_deg, pitch_deg)
        angle = np.arctan2(np.linalg.norm(np.cross(seen, forward)), seen @ forward)
        self.degrees = max(self.degrees, float(np.rad2deg(angle)))

    def check(self, what: str, degrees: float = 0.1) -> None:
        """Within what the issue asks for."""
        print(f"{what}: at most {1000 * self.metres:.2f} mm, {self.degrees:.6f}°")  # noqa: T201
        assert 0.0 < self.metres <= 0.02
        assert self.degrees <= degrees


def _enu(place: Sequence[float], origin: Origin) -> tuple[float, float, float]:
    return pymap3d.geodetic2enu(*place, origin.latitude_deg, origin.longitude_deg, origin.altitude_m)


def _forward(yaw_deg: float, pitch_deg: float) -> np.ndarray:
    yaw, pitch = np.deg2rad([yaw_deg, pitch_deg])
    return np.array([np.sin(yaw) * np.cos(pitch), np.cos(yaw) * np.cos(pitch), np.sin(pitch)])


def _view(generator: np.random.Generator, number: int, origin: Origin) -> MissionView:
    position = np.append(generator.uniform(-500, 500, 2), generator.uniform(5, 120))
    yaw, pitch = generator.uniform(0, 360), generator.uniform(-90, 30)
    pitch = generator.choice([pitch, pitch, pitch, -90.0, 0.0])
    if generator.random() < 0.5:
        camera = camera_at(position, yaw, pitch)
        quaternion = quaternion_from_matrix(camera.rotation)
        pose: FramePose | VehiclePose = FramePose(
            position=tuple(position.tolist()), orientation_wxyz=tuple(quaternion.tolist())
        )
    else:
        latitude, longitude, altitude = map(
            float,
            pymap3d.enu2geodetic(*position, origin.latitude_deg, origin.longitude_deg, origin.altitude_m),
        )
        pose = VehiclePose(
            latitude_deg=latitude,
            longitude_deg=longitude,
            altitude_m=altitude,
            altitude_datum=origin.altitude_datum,
            yaw_deg=float(yaw),
            pitch_deg=float(pitch),
        )
    return MissionView(id=f"view-{number}", pose=pose)


def _flight(generator: np.random.Generator) -> Flight:
    latitude, longitude = PLACES[generator.choice(list(PLACES))]
    datum = AltitudeDatum(generator.choice([one.value for one in AltitudeDatum]))
    altitude = 0.0 if datum is AltitudeDatum.TAKEOFF else float(generator.uniform(-20, 3000))
    origin = Origin(latitude_deg=latitude, longitude_deg=longitude, altitude_m=altitude, altitude_datum=datum)
    options = {
        "home_latitude_deg": latitude,
        "home_longitude_deg": longitude,
        "home_altitude_m": altitude,
        "lowest_height_m": -1.0,  # 500 m away the Earth falls off by 2 cm
        "transit_height_m": float(generator.choice([20.0, 60.0])),
        "format": "csv",
    }
    views = tuple(_view(generator, number, origin) for number in range(generator.integers(1, 6)))
    return Flight(WorldFrame(origin, Alignment(status=AlignmentStatus.ALIGNED)), origin, views, options)


@pytest.fixture(scope="session")
def flights() -> tuple[Flight, ...]:
    """Random rankings at the equator, far north, and on both sides of the antimeridian."""
    generator = np.random.default_rng(13)
    return tuple(_flight(generator) for _ in range(5 * hypothesis.settings.default.max_examples))


@pytest.fixture
def errors() -> Errors:
    """Counts how far parsed views are from those that were written."""
    return Errors()


@pytest.fixture
def scene() -> Callable[..., WorldFrame]:
    """Makes the world frame of a scene in the Alps."""

    def make(datum: str = "sea-level", altitude_m: float = 500.0) -> WorldFrame:
        origin = Origin(
            latitude_deg=46.02,
            longitude_deg=7.75,
            altitude_m=altitude_m,
            altitude_datum=AltitudeDatum(datum),
        )
        return WorldFrame(origin, Alignment(status=AlignmentStatus.ALIGNED))

    return make
