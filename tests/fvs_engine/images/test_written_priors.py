import io
from datetime import UTC, datetime

import pytest
from PIL import Image

from fvs_engine.images.metadata import PhotographPriors, read_priors
from fvs_engine.images.written_priors import prior_tags


def _read_back(priors: PhotographPriors) -> PhotographPriors:
    exif, xmp = prior_tags(priors)
    file = io.BytesIO()
    Image.new("RGB", (8, 8)).save(file, "JPEG", exif=exif, xmp=xmp)
    file.seek(0)
    return read_priors(file)


@pytest.mark.parametrize(
    ("latitude", "longitude", "altitude"),
    [(47.12345678, 8.87654321, 412.345), (-0.5, -179.99999999, -12.5), (89.999999, 0.0, 0.0)],
)
def test_what_was_written_is_read_to_the_millimetre(
    latitude: float, longitude: float, altitude: float
) -> None:
    taken = datetime(2026, 11, 27, 12, 30, 5, 250_000, tzinfo=UTC)
    read = _read_back(
        PhotographPriors(latitude, longitude, altitude, -170.25, -89.5, 1.5, taken, False, 39.8)
    )
    assert read.latitude_deg == pytest.approx(latitude, abs=1e-8)
    assert read.longitude_deg == pytest.approx(longitude, abs=1e-8)
    assert read.altitude_m == pytest.approx(altitude, abs=1e-3)
    assert (read.yaw_deg, read.pitch_deg, read.roll_deg) == (-170.25, -89.5, 1.5)
    assert read.captured_at == taken
    assert read.height_above_takeoff_m == 39.8
    assert not read.doubtful


def test_what_is_not_known_is_not_written() -> None:
    assert _read_back(PhotographPriors()) == PhotographPriors()
    assert _read_back(PhotographPriors(pitch_deg=-20.0)) == PhotographPriors(pitch_deg=-20.0)
