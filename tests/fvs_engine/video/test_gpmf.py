import struct
from datetime import UTC, datetime

import pytest
from videos import gps5, gps9, piece

from fvs_engine.video.gpmf import is_gpmf, read_gpmf

HERE, THERE = (47.1, -8.5, 412.25), (47.2, -8.6, 413.0)


def deep_pieces() -> bytes:
    packet = b""
    for _ in range(2000):
        packet = piece("DEVC", "", 4, packet)
    return packet


def test_positions_are_spread_over_their_packet() -> None:
    packet = gps5([HERE, THERE])
    assert is_gpmf(packet)
    first, second = read_gpmf(packet, 3.0, 1.0)
    assert (first.time_s, second.time_s) == (3.0, 3.5)
    assert first.priors.latitude_deg == pytest.approx(HERE[0])
    assert first.priors.longitude_deg == pytest.approx(HERE[1])
    assert first.priors.altitude_m == pytest.approx(HERE[2])
    assert second.priors.captured_at == datetime(2026, 11, 27, 12, 0, 0, 500_000, tzinfo=UTC)


def test_newer_cameras_tell_time_and_fix_of_each_position() -> None:
    packet = gps9((*HERE, 366, 1.5, 1.2, 3), (*THERE, 366, 1.6, 1.2, 0), (*THERE, 366, 1.7, 9.9, 3))
    (record,) = read_gpmf(packet, 0.0, 1.0)
    assert record.priors.latitude_deg == pytest.approx(HERE[0])
    assert record.priors.captured_at == datetime(2001, 1, 1, 0, 0, 1, 500_000, tzinfo=UTC)


@pytest.mark.parametrize(
    "packet", [gps5([HERE], lock=0), gps5([HERE], dilution=9999), gps5([(0.0, 0.0, 0.0)]), b"", b"DEVC"]
)
def test_without_a_fix_there_is_no_record(packet: bytes) -> None:
    assert read_gpmf(packet, 0.0, 1.0) == []


def test_a_packet_that_is_cut_anywhere_raises_nothing() -> None:
    packet = gps5([HERE, THERE], utc="a broken clock!!")
    assert [record.priors.captured_at for record in read_gpmf(packet, 0.0, 1.0)] == [None, None]
    assert all(len(read_gpmf(packet[:end], 0.0, 1.0)) <= 2 for end in range(len(packet)))
    for changed in range(len(packet)):
        read_gpmf(packet[:changed] + b"\xff" + packet[changed + 1 :], 0.0, 1.0)


@pytest.mark.parametrize(
    "packet",
    [
        gps9((*HERE, 10**9, 0.0, 1.2, 3)).replace(piece("SCAL", "l", 4)[:6], piece("SCAL", "s", 3)[:6]),
        deep_pieces(),
    ],
)
def test_damaged_scales_and_pieces_in_pieces_have_no_record(packet: bytes) -> None:
    assert read_gpmf(packet, 0.0, 1.0) == []


def test_a_damaged_day_is_no_time() -> None:
    (record,) = read_gpmf(gps9((*HERE, 10**9, 0.0, 1.2, 3)), 0.0, 1.0)
    assert record.priors.captured_at is None


@pytest.mark.parametrize(("datum", "above_ellipsoid"), [(b"", True), (b"WGS8", True), (b"MSLV", False)])
def test_cameras_tell_what_altitudes_are_above(datum: bytes, above_ellipsoid: bool) -> None:
    told = piece("GPSA", "F", 4, datum) if datum else b""
    (record,) = read_gpmf(gps5([HERE], before=told), 0.0, 1.0)
    assert record.above_ellipsoid == above_ellipsoid


def test_the_positions_of_a_karma_are_above_sea_level() -> None:
    scales = struct.pack(">9i", 1000, 10_000_000, 10_000_000, 1000, 1000, 100, 100, 100, 100)
    sample = struct.pack(">I4i3hH", 146_000, 471_000_000, -85_000_000, 412_250, 2_000, 1, 2, 3, 35_999)
    stream = piece("SCAL", "l", 4, scales) + piece("GLPI", "?", 28, sample)
    (record,) = read_gpmf(piece("DEVC", "", 1, piece("STRM", "", 1, stream)), 3.0, 1.0)
    assert not record.above_ellipsoid
    priors = record.priors
    assert (priors.latitude_deg, priors.longitude_deg, priors.altitude_m) == pytest.approx(HERE)
