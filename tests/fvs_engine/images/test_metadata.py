import io
from collections.abc import Callable
from datetime import UTC, datetime, timedelta, timezone
from typing import Any

import piexif
import pytest
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from fvs_engine.images import metadata
from fvs_engine.images.metadata import PhotographPriors

DEGREES, MINUTES, SECONDS = (48, 1), (18, 1), (3600, 100)


def read_priors(content: bytes) -> PhotographPriors:
    return metadata.read_priors(io.BytesIO(content))


def _jpeg(exif: dict[str, Any] | None = None, xmp: str = "") -> bytes:
    out = io.BytesIO()
    options = {"exif": piexif.dump(exif)} if exif else {}
    Image.new("RGB", (8, 8)).save(out, "JPEG", **options)
    content = out.getvalue()
    return _with_packets(content, xmp.encode()) if xmp else content


def _with_packets(content: bytes, *packets: bytes) -> bytes:
    segments = b""
    for packet in packets:
        named = b"http://ns.adobe.com/xap/1.0/\0" + packet
        segments += b"\xff\xe1" + (len(named) + 2).to_bytes(2, "big") + named
    return content[:2] + segments + content[2:]


def _gps(**changes: Any) -> dict[str, Any]:
    tags = {
        "GPSLatitudeRef": b"S",
        "GPSLatitude": (DEGREES, MINUTES, SECONDS),
        "GPSLongitudeRef": b"E",
        "GPSLongitude": ((7, 1), (30, 1), (0, 1)),
        "GPSAltitudeRef": 0,
        "GPSAltitude": (4125, 10),
        **changes,
    }
    return {"GPS": {getattr(piexif.GPSIFD, name): value for name, value in tags.items() if value is not None}}


def _xmp(attributes: str = "", elements: str = "") -> str:
    return (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        f'<rdf:Description xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/" {attributes}>{elements}'
        "</rdf:Description></rdf:RDF></x:xmpmeta>"
    )


def test_a_fix_is_read_with_its_hemispheres() -> None:
    priors = read_priors(_jpeg(_gps()))
    assert priors.latitude_deg == pytest.approx(-(48 + 18 / 60 + 36 / 3600))
    assert priors.longitude_deg == pytest.approx(7.5)
    assert priors.altitude_m == pytest.approx(412.5)
    assert not priors.doubtful
    west = read_priors(_jpeg(_gps(GPSLongitudeRef=b"W", GPSAltitudeRef=1)))
    assert (west.longitude_deg, west.altitude_m) == (pytest.approx(-7.5), pytest.approx(-412.5))


@pytest.mark.parametrize(
    "latitude",
    [
        ((48, 1), (1_830, 100), (0, 0)),
        ((48, 1), (1_830, 100), (0, 1)),
        ((48, 1), (1_830, 100)),
        ((48_305, 1_000), (0, 0), (0, 0)),
        ((48_305, 1_000), (0, 1)),
        (48_305, 1_000),
    ],
)
def test_degrees_and_minutes_may_be_decimal_numbers(latitude: Any) -> None:
    priors = read_priors(_jpeg(_gps(GPSLatitude=latitude)))
    assert priors.latitude_deg == pytest.approx(-48.305)
    assert priors.longitude_deg == 7.5


@pytest.mark.parametrize(("reference", "sign"), [(None, 1), (0, 1), (1, -1), (2, 1), (3, -1)])
def test_altitudes_are_above_or_below_either_reference_of_exif_3(reference: int | None, sign: int) -> None:
    priors = read_priors(_jpeg(_gps(GPSAltitudeRef=reference, GPSAltitude=(430, 1))))
    assert priors.altitude_m == sign * 430.0


def _in_format(file_format: str, exif: bytes, packet: bytes) -> bytes:
    out = io.BytesIO()
    options: dict[str, Any] = {"exif": exif, "xmp": packet}
    if file_format == "PNG":
        options["pnginfo"] = PngInfo()
        options["pnginfo"].add_itxt("XML:com.adobe.xmp", packet.decode(), zip=True)
    elif file_format == "TIFF":
        options["exif"] = Image.Exif()
        options["exif"].load(exif)
        options["exif"][700] = packet
    Image.new("RGB", (8, 8)).save(out, file_format, **options)
    return out.getvalue()


@pytest.mark.parametrize("file_format", ["JPEG", "PNG", "TIFF", "WEBP"])
def test_every_format_has_its_fix_and_attitude(file_format: str) -> None:
    exif = piexif.dump(_gps() | {"Exif": {piexif.ExifIFD.DateTimeOriginal: b"2026:05:04 03:02:01"}})
    packet = _xmp('drone-dji:GimbalYawDegree="-12.5" drone-dji:GimbalPitchDegree="-30.0"').encode()
    priors = read_priors(_in_format(file_format, exif, packet))
    assert (priors.latitude_deg, priors.longitude_deg) == (pytest.approx(-48.31), 7.5)
    assert (priors.altitude_m, priors.yaw_deg, priors.pitch_deg) == (412.5, -12.5, -30.0)
    assert priors.captured_at == datetime(2026, 5, 4, 3, 2, 1, tzinfo=UTC)


def test_the_exif_of_a_webp_may_have_the_prefix_of_jpeg() -> None:
    block = piexif.dump(_gps())
    chunk = b"EXIF" + len(block).to_bytes(4, "little") + block + b"\0" * (len(block) % 2)
    content = _in_format("WEBP", b"", b"")
    assert read_priors(content + chunk).longitude_deg == 7.5


@pytest.mark.parametrize(
    "changed",
    [
        lambda xmp: xmp.replace("x:xmpmeta", "xmp:xmpmeta").replace("xmlns:x=", "xmlns:xmp="),
        lambda xmp: (
            xmp.replace("x:xmpmeta", "ns0:xmpmeta").replace("rdf:", "ns1:").replace("drone-dji", "ns2")
        ),
        lambda xmp: xmp[xmp.index("<rdf:RDF") : xmp.index("</x:xmpmeta>")],
        lambda xmp: xmp.replace("<rdf:Description", '<rdf:Description dc:title="Rock & Roll"'),
        lambda xmp: xmp.replace("<rdf:Description", '<rdf:Description dc:title="caf\xe9"'),
        lambda xmp: "<?xpacket begin='\ufeff' id='W5M0MpCehiHzreSzNTczkc9d'?>" + xmp + "<?xpacket end='w'?>",
        lambda xmp: xmp.replace("drone-dji:", "").replace('"', "'"),
        lambda xmp: xmp.replace("Degree=", "Degree \n = "),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
def test_gimbal_angles_are_found_in_packets_of_all_kinds(
    changed: Callable[[str], str], encoding: str
) -> None:
    values = 'drone-dji:GimbalYawDegree="-12.5"\n drone-dji:GimbalPitchDegree="-30.0"'
    packet = changed(_xmp(values)).encode(encoding, errors="ignore")
    priors = read_priors(_with_packets(_jpeg(), packet))
    assert (priors.yaw_deg, priors.pitch_deg) == (-12.5, -30.0)


def test_every_packet_of_a_file_is_read() -> None:
    first = _xmp('xmp:CreatorTool="retouched"').encode()
    second = _xmp(
        'drone-dji:GimbalYawDegree="10.0"', "<drone-dji:GimbalRollDegree>1.0</drone-dji:GimbalRollDegree>"
    )
    priors = read_priors(_with_packets(_jpeg(), first, second.encode()))
    assert (priors.yaw_deg, priors.roll_deg) == (10.0, 1.0)


def test_metadata_of_a_preview_is_not_that_of_the_photograph() -> None:
    preview = _jpeg(_gps(), _xmp('drone-dji:GimbalYawDegree="10.0"'))
    out = io.BytesIO()
    Image.new("RGB", (8, 8)).save(out, "JPEG", comment=preview)
    assert read_priors(out.getvalue() + preview) == PhotographPriors()


@pytest.mark.parametrize(
    "changes",
    [
        {"GPSLatitudeRef": None},
        {"GPSLongitudeRef": b"Q"},
        {"GPSLongitude": None},
        {"GPSLatitude": ((0, 1), (0, 1), (0, 1)), "GPSLongitude": ((0, 1), (0, 1), (0, 1))},
        {"GPSLatitude": ((91, 1), (0, 1), (0, 1))},
        {"GPSLatitude": ((48, 0), (0, 1), (0, 1))},
        {"GPSLatitude": ((0, 0), (18, 1), (0, 1))},
        {"GPSLatitude": ((48, 1), (18, 0))},
        {"GPSLatitude": ((48, 1), (18, 1), (36, 1), (0, 1))},
    ],
)
def test_a_fix_that_cannot_be_true_is_left_out_and_said(changes: dict[str, Any]) -> None:
    priors = read_priors(_jpeg(_gps(**changes)))
    assert (priors.latitude_deg, priors.longitude_deg, priors.altitude_m) == (None, None, None)
    assert priors.doubtful


@pytest.mark.parametrize("longitude", ["GpsLongitude", "GpsLongtitude"])
@pytest.mark.parametrize("as_elements", [True, False])
def test_gimbal_angles_and_dji_positions_are_read(longitude: str, as_elements: bool) -> None:
    values = {
        "GpsLatitude": "+22.5",
        longitude: "-113.25",
        "AbsoluteAltitude": "+84.10",
        "GimbalYawDegree": "-127.60",
        "GimbalPitchDegree": "-89.90",
        "GimbalRollDegree": "+0.00",
    }
    if as_elements:
        xmp = _xmp(elements="".join(f"<drone-dji:{k}>{v}</drone-dji:{k}>" for k, v in values.items()))
    else:
        xmp = _xmp(attributes=" ".join(f'drone-dji:{k}="{v}"' for k, v in values.items()))
    priors = read_priors(_jpeg(xmp=xmp))
    assert (priors.latitude_deg, priors.longitude_deg, priors.altitude_m) == (22.5, -113.25, 84.1)
    assert (priors.yaw_deg, priors.pitch_deg, priors.roll_deg) == (-127.6, -89.9, 0.0)


@pytest.mark.parametrize(
    ("direction", "reference", "yaw_deg"),
    [
        ((23_456, 100), b"T", 234.56),
        ((0, 1), b"T", 0.0),
        ((360, 1), b"t", 360.0),
        ((23_456, 100), b"M", None),  # off by the declination
        ((23_456, 100), b"", None),
        ((23_456, 100), None, None),
        (None, b"T", None),
        ((361, 1), b"T", None),
        ((1, 0), b"T", None),
        ((4_294_967_295, 1), b"T", None),
    ],
)
def test_the_direction_in_exif_is_a_yaw_if_it_is_from_true_north(
    direction: tuple[int, int] | None, reference: bytes | None, yaw_deg: float | None
) -> None:
    priors = read_priors(_jpeg(_gps(GPSImgDirection=direction, GPSImgDirectionRef=reference)))
    assert priors.yaw_deg == yaw_deg
    assert priors.latitude_deg is not None
    assert not priors.doubtful


@pytest.mark.parametrize(("gimbal", "yaw_deg"), [("-10.5", -10.5), ("+0.00", 0.0), ("NaN", 200.0)])
def test_the_gimbal_knows_better_than_the_direction_in_exif(gimbal: str, yaw_deg: float) -> None:
    exif = _gps(GPSImgDirection=(200, 1), GPSImgDirectionRef=b"T")
    xmp = _xmp(f'drone-dji:GimbalYawDegree="{gimbal}" drone-dji:GimbalPitchDegree="-30.0"')
    priors = read_priors(_jpeg(exif, xmp))
    assert (priors.yaw_deg, priors.pitch_deg) == (yaw_deg, -30.0)


@pytest.mark.parametrize(
    ("written", "height_m"), [("+39.80", 39.8), ("-3.50", -3.5), ("1e9", None), ("n/a", None)]
)
def test_the_height_above_takeoff_is_read_beside_the_altitude(written: str, height_m: float | None) -> None:
    priors = read_priors(
        _jpeg(_gps(), _xmp(f'drone-dji:AbsoluteAltitude="+198.31" drone-dji:RelativeAltitude="{written}"'))
    )
    assert priors.height_above_takeoff_m == height_m
    assert priors.altitude_m == read_priors(_jpeg(_gps())).altitude_m


def test_exif_wins_over_xmp_and_xmp_helps_out() -> None:
    xmp = _xmp('drone-dji:GpsLatitude="1.5" drone-dji:GpsLongitude="2.5"')
    assert read_priors(_jpeg(_gps(), xmp)).longitude_deg == pytest.approx(7.5)
    helped = read_priors(_jpeg(_gps(GPSLatitudeRef=None), xmp))
    assert (helped.latitude_deg, helped.doubtful) == (1.5, False)


@pytest.mark.parametrize(
    "xmp",
    [
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><broken</x:xmpmeta>',
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"',
        _xmp('drone-dji:GimbalYawDegree="NaN" drone-dji:GimbalPitchDegree="down"'),
        _xmp('drone-dji:GimbalYawDegree="1e9"'),
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><!DOCTYPE a [<!ENTITY b "c">]>&b;</x:xmpmeta>',
    ],
)
def test_damaged_metadata_says_nothing(xmp: str) -> None:
    assert read_priors(_jpeg(xmp=xmp)) == PhotographPriors()


@pytest.mark.parametrize(
    "damage", [lambda _: b"", lambda c: c[:40], lambda c: c[:30] + b"\xff" * 60 + c[90:]]
)
def test_damaged_files_do_not_raise(damage: Callable[[bytes], bytes]) -> None:
    assert read_priors(damage(_jpeg(_gps()))) == PhotographPriors()


def test_the_time_has_its_zone_and_fraction() -> None:
    exif = {"Exif": {piexif.ExifIFD.DateTimeOriginal: b"2026:05:04 03:02:01"}}
    assert read_priors(_jpeg(exif)).captured_at == datetime(2026, 5, 4, 3, 2, 1, tzinfo=UTC)
    exif["Exif"] |= {0x9291: b"25", 0x9011: b"-03:30"}
    zone = timezone(-timedelta(hours=3, minutes=30))
    moment = read_priors(_jpeg(exif)).captured_at
    assert moment == datetime(2026, 5, 4, 3, 2, 1, 250_000, tzinfo=zone)


def test_a_packet_of_unfinished_properties_takes_no_time() -> None:
    texts = PngInfo()
    texts.add_itxt("XML:com.adobe.xmp", ":GpsLatitude>" * 80_000)  # each could extend to the end
    content = io.BytesIO()
    Image.new("L", (16, 16)).save(content, "PNG", pnginfo=texts)
    assert read_priors(content.getvalue()) == PhotographPriors()
