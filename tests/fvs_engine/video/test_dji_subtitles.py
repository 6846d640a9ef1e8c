from dataclasses import astuple
from datetime import UTC, datetime

import pytest

from fvs_engine.video.dji_subtitles import read_subtitle, read_subtitles

NEW = """1
00:00:00,000 --> 00:00:00,033
<font size="28">FrameCnt: 1, DiffTime: 33ms
2023-05-31 19:04:26.691
[iso: 100] [shutter: 1/640.0] [fnum: 280] [focal_len: 24.00] [dzoom_ratio: 1.00], [latitude: -37.920295]
[longitude: 176.456417] [rel_alt: 62.370 abs_alt: 227.373] \
[gb_yaw: -142.5 gb_pitch: -28.7 gb_roll: 0.0] </font>

2
00:00:00,033 --> 00:00:00,066
<font size="28">FrameCnt: 2, DiffTime: 33ms
2023-05-31 19:04:26.724
[latitude: -37.920296] [longitude: 176.456418] [rel_alt: 62.370 abs_alt: 227.400] </font>
"""


def test_fields_in_brackets_are_read_with_their_times() -> None:
    first, second = read_subtitles(NEW)
    assert first.time_s == 0.0
    assert second.time_s == pytest.approx(0.033)
    taken = datetime(2023, 5, 31, 19, 4, 26, 691_000, tzinfo=UTC)
    assert astuple(first.priors)[:7] == (-37.920295, 176.456417, 227.373, -142.5, -28.7, 0.0, taken)
    assert second.priors.altitude_m == 227.4
    assert second.priors.height_above_takeoff_m == 62.37
    assert second.priors.yaw_deg is None


@pytest.mark.parametrize(
    ("text", "position"),
    [
        (
            "[latitude : 38.904148] [longtitude : -92.281307] [altitude: 274.239] </font>",
            (38.904148, -92.281307, 274.239),
        ),
        ("[latitude: 47.1] [longitude: 8.5] [rel_alt: 3.000]", (47.1, 8.5, None)),
        (
            "HOME(131.1660,-25.2088) 2017.07.29 15:19:23\nGPS(131.1655,-25.2089,14) BAROMETER:4.5",
            (-25.2089, 131.1655, None),
        ),
        ("2022.06.21 16:06:46\nGPS(36.6145,-6.1120,0.0M) BAROMETER:79.8M", (36.6145, -6.1120, None)),
    ],
)
def test_each_form_has_its_order_and_its_altitude(text: str, position: tuple[float, ...]) -> None:
    priors = read_subtitle(text)
    assert priors is not None
    assert (priors.latitude_deg, priors.longitude_deg, priors.altitude_m) == position


def test_the_altitude_of_home_and_the_angles_of_the_gimbal_are_read() -> None:
    priors = read_subtitle(
        "F/6.3, SS 60, ISO 100, EV 0, RTK (120.083799, 30.213635, 28), "
        "HOME (120.083800, 30.213640, 103.55m), D 75.36m, H 76.19m, H.S 0.00m/s, V.S 0.00m/s, "
        "F.PRY (-5.3°, 2.1°, 28.3°), G.PRY (-40.0°, 0.5°, 28.2°)"
    )
    assert priors is not None
    assert (priors.latitude_deg, priors.longitude_deg) == (30.213635, 120.083799)
    assert priors.altitude_m == pytest.approx(179.74)
    assert (priors.pitch_deg, priors.roll_deg, priors.yaw_deg) == (-40.0, 0.5, 28.2)
    assert priors.height_above_takeoff_m == 76.19


@pytest.mark.parametrize(
    "text",
    [
        "And then we flew north.",
        "[iso: 100] [latitude: 0.000000] [longitude: 0.000000] [rel_alt: 0.000 abs_alt: 0.000]",
        "[latitude: 147.0] [longitude: 8.5]",
        "GPS(n/a,n/a,0) BAROMETER:0.0",
        "GPS(",
        "",
    ],
)
def test_what_has_no_position_is_no_record(text: str) -> None:
    assert read_subtitle(text) is None


def test_a_time_that_is_none_is_left_out() -> None:
    priors = read_subtitle("2023-13-41 25:04:26.691 [latitude: 47.1] [longitude: 8.5]")
    assert priors is not None
    assert priors.captured_at is None


@pytest.mark.parametrize("text", ["", "GPS", "1\n", "no subtitles at all"])
def test_a_file_without_subtitles_has_no_records(text: str) -> None:
    assert read_subtitles(text) == []


@pytest.mark.parametrize("number", ["-33,900007", "1234567890.5", "33.9.1"])
def test_the_beginning_of_a_number_is_no_number(number: str) -> None:
    assert read_subtitle(f"[latitude: {number}] [longitude: 8.5] [rel_alt: 3.0 abs_alt: 412.5]") is None


@pytest.mark.parametrize("text", ["a", "1", "GPS(", "GPS(8.5,", "a:1", "a ", "00:00:00,0 "])
def test_long_texts_are_read_in_one_pass(text: str) -> None:
    assert read_subtitles("00:00:00,000 --> 00:00:01,000" + text * (400_000 // len(text))) == []
