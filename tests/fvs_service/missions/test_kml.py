"""KML, validated by the schema of KML 2.2 and read by fastkml."""

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastkml import KML
from fastkml.validator import validate
from fvs_service.errors import InvalidRequestError
from fvs_service.missions.writing import write_mission

from fvs_schema.missions import MissionOptions, MissionView
from fvs_schema.poses import VehiclePose
from fvs_schema.terrain import Terrain


def _marks(content: bytes, file: Path) -> dict[str, Any]:
    """The placemarks of a valid document, by name."""
    file.write_bytes(content)
    assert validate(file_to_validate=file)
    (document,) = KML.parse(io.BytesIO(content)).features
    marks = {mark.name: mark for mark in document.features}
    assert len(marks) == len(document.features)
    return marks


def test_many_missions_come_back_from_kml(flights: Any, errors: Any, tmp_path: Path) -> None:
    for flight in flights:
        if flight.origin.altitude_datum == "takeoff":
            continue
        geoid_m = 47.0 if flight.origin.altitude_datum == "ellipsoid" else 0.0
        marks = _marks(flight.write(format="kml", geoid_height_m=47.0), tmp_path / "mission.kml")
        views = [mark for mark in marks.values() if mark.view is not None]
        for view, mark in zip(flight.views, views, strict=True):
            camera, (longitude, latitude, altitude) = mark.view, mark.geometry.coords[0]
            assert mark.name.split()[1] == view.id
            assert camera.altitude_mode.value == mark.kml_geometry.altitude_mode.value == "absolute"
            seen = (camera.longitude, camera.latitude, camera.altitude)
            np.testing.assert_allclose(seen, (longitude, latitude, altitude), rtol=0, atol=1e-4)
            place = (latitude, longitude, altitude + geoid_m)
            errors.add(flight, view, place, camera.heading, camera.tilt - 90.0)
        waypoints = [mark.geometry.coords[0] for name, mark in marks.items() if name[0].isdigit()]
        assert list(marks["route"].geometry.coords) == waypoints
        assert marks["home"].geometry.coords[0][:2] == (
            flight.origin.longitude_deg,
            flight.origin.latitude_deg,
        )
    errors.check("KML")


def _view(**pose: Any) -> MissionView:
    place = {"latitude_deg": 46.0201, "longitude_deg": 7.7501, "altitude_m": 520.0}
    return MissionView(id="a", pose=VehiclePose(**{**place, "yaw_deg": 90.0, "pitch_deg": -30.0, **pose}))


def test_altitudes_may_be_above_the_ground(scene: Any, tmp_path: Path) -> None:
    terrain = Terrain(
        **{"south_deg": 46.01, "west_deg": 7.74, "latitude_step_deg": 0.02, "longitude_step_deg": 0.02},
        **{"columns": 2, "heights_m": (503.0,) * 4},
    )
    wanted = MissionOptions.model_validate(
        {
            **{"format": "kml", "above_ground": True, "geofence": "46.01,7.74;46.03,7.74;46.02,7.76"},
            **{"home_latitude_deg": 46.02, "home_longitude_deg": 7.75},
        }
    )
    file = write_mission("m", scene(), [_view()], (), wanted, None, terrain=terrain)
    marks = _marks(file.content, tmp_path / "mission.kml")
    point = marks["1 a"].kml_geometry
    assert point.altitude_mode.value == marks["1 a"].view.altitude_mode.value == "relativeToGround"
    assert marks["1 a"].geometry.coords[0][2] == pytest.approx(17.0)
    assert len(marks["geofence"].geometry.exterior.coords) == 4


@pytest.mark.parametrize(
    ("datum", "hint"),
    [
        ("takeoff", "Choose a format that has altitudes above home"),
        ("ellipsoid", "Give geoid_height_m, the height of the geoid"),
    ],
)
def test_altitudes_above_sea_level_must_be_known(scene: Any, datum: str, hint: str) -> None:
    wanted = MissionOptions.model_validate({"format": "kml"})
    with pytest.raises(InvalidRequestError, match="cannot be converted for KML") as refused:
        write_mission("m", scene(datum, 0.0), [_view(altitude_datum=datum)], (), wanted, None)
    assert refused.value.hint.startswith(hint)
