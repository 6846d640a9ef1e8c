from datetime import UTC, datetime, timedelta

import pytest

from fvs_engine.images.metadata import PhotographPriors
from fvs_engine.video.track import Record, Track

NOON = datetime(2026, 11, 27, 12, tzinfo=UTC)


def test_between_two_records_everything_moves() -> None:
    track = Track(
        [
            Record(2.0, PhotographPriors(47.2, -179.9, 402.0, -170.0, -40.0, 2.0)),
            Record(1.0, PhotographPriors(47.0, 179.9, 400.0, 170.0, -20.0, -2.0, NOON)),
        ]
    )
    priors = track.at(1.75)
    assert priors.latitude_deg == pytest.approx(47.15)
    assert priors.longitude_deg == pytest.approx(-179.95)  # over the antimeridian, not around the earth
    assert (priors.altitude_m, priors.pitch_deg, priors.roll_deg) == pytest.approx((401.5, -35.0, 1.0))
    assert priors.yaw_deg == pytest.approx(-175.0)
    assert priors.captured_at == NOON + timedelta(seconds=0.75)


def test_a_gap_has_no_position_but_near_its_ends() -> None:
    track = Track([Record(1.0, PhotographPriors(47.0, 8.0)), Record(11.0, PhotographPriors(48.0, 9.0))])
    assert [track.at(time_s).latitude_deg for time_s in (-0.5, 0.5, 1.9, 6.0, 10.5, 11.5, 12.5)] == [
        *(None, 47.0, 47.0, None),
        *(48.0, 48.0, None),
    ]
    assert Track([]).at(0.0) == PhotographPriors()


def test_what_one_of_two_records_does_not_have_is_not_made_up() -> None:
    track = Track([Record(0.0, PhotographPriors(47.0, 8.0, 400.0)), Record(1.0, PhotographPriors(47.0, 8.0))])
    priors = track.at(0.5)
    assert (priors.latitude_deg, priors.altitude_m, priors.yaw_deg) == (47.0, None, None)
