import struct
from collections.abc import Callable
from typing import Any

import piexif
import pytest

Photograph = Callable[..., bytes]


def _gps(latitude: tuple[int, int, int], longitude: tuple[int, int, int]) -> dict[str, Any]:
    return {
        "GPS": {
            piexif.GPSIFD.GPSLatitudeRef: b"N",
            piexif.GPSIFD.GPSLatitude: tuple((part, 1) for part in latitude),
            piexif.GPSIFD.GPSLongitudeRef: b"E",
            piexif.GPSIFD.GPSLongitude: tuple((part, 1) for part in longitude),
            piexif.GPSIFD.GPSAltitudeRef: 0,
            piexif.GPSIFD.GPSAltitude: (4125, 10),
        }
    }


def test_the_first_fix_becomes_the_origin_and_stays(gateway: Any, photograph: Photograph) -> None:
    scene = gateway.scene()
    image = gateway.put(scene, photograph(1, exif=_gps((48, 18, 0), (7, 15, 0)))).json()
    assert image["prior"]["latitude_deg"] == pytest.approx(48.3)
    assert image["prior"]["source"] == "metadata"
    origin = gateway.client.get(f"/v1/scenes/{scene}").json()["origin"]
    assert origin == {
        "latitude_deg": pytest.approx(48.3),
        "longitude_deg": pytest.approx(7.25),
        "altitude_m": pytest.approx(412.5),
        "altitude_datum": "sea-level",
    }
    gateway.put(scene, photograph(2, exif=_gps((48, 19, 0), (7, 15, 0))))
    assert gateway.client.get(f"/v1/scenes/{scene}").json()["origin"] == origin


def test_what_the_sender_knows_wins_over_the_file(gateway: Any, photograph: Photograph) -> None:
    scene = gateway.scene()
    told = {"latitude_deg": 1.5, "longitude_deg": 2.5, "altitude_m": 3.5, "yaw_deg": 90, "pitch_deg": -45}
    prior = gateway.put(scene, photograph(exif=_gps((48, 18, 0), (7, 15, 0))), **told).json()["prior"]
    assert prior["source"] == "request"
    assert {name: prior[name] for name in told} == told


def test_what_the_sender_does_not_tell_is_taken_from_the_file(gateway: Any, photograph: Photograph) -> None:
    scene = gateway.scene()
    attitude = {"yaw_deg": 90.0, "pitch_deg": -45.0}
    here = {"latitude_deg": 48.31, "longitude_deg": 7.26, "altitude_m": 500.0}
    fix = _gps((48, 18, 0), (7, 15, 0))
    by_gps = gateway.put(scene, photograph(1, exif=fix), **attitude).json()["prior"]
    assert by_gps["source"] == "metadata"
    assert by_gps["latitude_deg"] == pytest.approx(48.3)
    assert {name: by_gps[name] for name in attitude} == attitude
    gimbal = _with_xmp(photograph(2, exif=fix), GimbalYawDegree="-30.5", GimbalPitchDegree="-60")
    by_sender = gateway.put(scene, gimbal, **here, pitch_deg=-50).json()["prior"]
    assert by_sender["source"] == "request"
    assert {name: by_sender[name] for name in here} == here
    assert (by_sender["yaw_deg"], by_sender["pitch_deg"]) == (-30.5, -50.0)


def test_standard_deviations_are_of_the_position_that_is_used(gateway: Any, photograph: Photograph) -> None:
    scene, accuracy = gateway.scene(), {"position_sigma_m": 0.02, "attitude_sigma_deg": 1.5}
    here = {"latitude_deg": 48.31, "longitude_deg": 7.26, "altitude_m": 500.0}
    fix = _gps((48, 18, 0), (7, 15, 0))
    of_file = gateway.put(scene, photograph(1, exif=fix), **accuracy).json()["prior"]
    assert of_file["source"] == "metadata"
    assert of_file["latitude_deg"] == pytest.approx(48.3)
    of_sender = gateway.put(scene, photograph(2, exif=fix), **here, **accuracy).json()["prior"]
    assert of_sender["source"] == "request"
    for prior in (of_file, of_sender):
        assert {name: prior[name] for name in accuracy} == accuracy
    assert gateway.put(scene, photograph(3), **accuracy).json()["prior"] is None  # of nothing
    for wrong in ({"position_sigma_m": -1}, {"attitude_sigma_deg": 181}, {"position_sigma_m": "nan"}):
        assert gateway.put(scene, photograph(4), **here, **wrong).status_code == 422


def test_a_compass_is_of_no_use_in_a_local_frame(gateway: Any, photograph: Photograph) -> None:
    scene = gateway.scene(world={"kind": "local"})
    gimbal = _with_xmp(photograph(1), GimbalYawDegree="-30.5", GimbalPitchDegree="-60")
    prior = gateway.put(scene, gimbal, x_m=1, y_m=2, z_m=3).json()["prior"]
    assert (prior["x_m"], prior["yaw_deg"], prior["pitch_deg"]) == (1.0, None, -60.0)
    assert gateway.put(scene, photograph(2), yaw_deg=10).json()["prior"]["yaw_deg"] == 10


def test_the_height_above_takeoff_is_the_file_s_whatever_the_sender_tells(
    gateway: Any, photograph: Photograph
) -> None:
    here = {"latitude_deg": 48.31, "longitude_deg": 7.26, "altitude_m": 500.0}
    photographs = [_with_xmp(photograph(seed), RelativeAltitude="+39.80") for seed in (1, 2, 3)]
    scene, local = gateway.scene(), gateway.scene(world={"kind": "local"})
    assert gateway.put(scene, photographs[0]).json()["prior"]["height_above_takeoff_m"] == 39.8
    told = gateway.put(scene, photographs[1], **here).json()["prior"]
    assert (told["altitude_m"], told["height_above_takeoff_m"]) == (500.0, 39.8)
    assert gateway.put(local, photographs[2]).json()["prior"] is None


def _with_xmp(jpeg: bytes, **angles: str) -> bytes:
    """The same JPEG with a gimbal's angles as DJI writes them."""
    told = " ".join(f'drone-dji:{name}="{value}"' for name, value in angles.items())
    packet = (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        f'<rdf:Description xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/" {told}/></rdf:RDF></x:xmpmeta>'
    )
    segment = b"http://ns.adobe.com/xap/1.0/\0" + packet.encode()
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(segment) + 2) + segment + jpeg[2:]


def test_positions_must_fit_the_world(gateway: Any, photograph: Photograph) -> None:
    automatic, local = gateway.scene(), gateway.scene(world={"kind": "local"})
    assert gateway.put(automatic, photograph(), x_m=1, y_m=2, z_m=3).status_code == 422
    assert gateway.put(local, photograph(), latitude_deg=1, longitude_deg=2, altitude_m=3).status_code == 422
    assert gateway.put(local, photograph(), x_m=1, y_m=2).status_code == 422
    assert gateway.put(local, photograph(), x_m="nan", y_m=2, z_m=3).status_code == 422
    assert gateway.put(local, photograph(), x_m=1, y_m=2, z_m=3).json()["prior"]["z_m"] == 3


def test_altitudes_must_be_above_what_the_scenes_are_above(gateway: Any, photograph: Photograph) -> None:
    origin = {"latitude_deg": 48.0, "longitude_deg": 7.0, "altitude_m": 400.0, "altitude_datum": "takeoff"}
    scene = gateway.scene(world={"kind": "enu", "origin": origin})
    here = {"latitude_deg": 48.0, "longitude_deg": 7.0, "altitude_m": 430.0}
    refused = gateway.put(scene, photograph(1), **here)
    assert refused.status_code == 422
    assert "above the place of takeoff, not sea level." in refused.json()["detail"]
    assert gateway.put(scene, photograph(1), altitude_datum="takeoff").status_code == 422
    assert gateway.put(scene, photograph(1), **here, altitude_datum="takeoff").status_code == 201
    by_gps = gateway.put(scene, photograph(2, exif=_gps((48, 18, 0), (7, 15, 0)))).json()
    assert (by_gps["verdict"], by_gps["warnings"]) == ("accepted", ["position-ignored"])
