"""Pose priors as metadata of a JPEG: EXIF, and DJI's XMP for what EXIF has no tags for."""

import math
from typing import NamedTuple

from PIL import Image
from PIL.ExifTags import GPS, IFD, Base

from fvs_engine.images.metadata import PhotographPriors

_XMP = (
    '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
    '<rdf:Description rdf:about="" xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/" {}/>'
    "</rdf:RDF></x:xmpmeta>"
)


class PriorTags(NamedTuple):
    """Metadata to save an image with; ``xmp`` may be empty."""

    exif: Image.Exif
    xmp: bytes


def prior_tags(priors: PhotographPriors) -> PriorTags:
    """The tags from which ``read_priors`` reads these priors."""
    exif = Image.Exif()
    if priors.captured_at is not None:
        taken = exif.get_ifd(IFD.Exif)
        taken[Base.DateTimeOriginal] = f"{priors.captured_at:%Y:%m:%d %H:%M:%S}"
        taken[Base.SubsecTimeOriginal] = f"{priors.captured_at.microsecond // 1000:03d}"
    gps = exif.get_ifd(IFD.GPSInfo)
    if priors.latitude_deg is not None and priors.longitude_deg is not None:
        gps[GPS.GPSLatitudeRef] = "N" if priors.latitude_deg >= 0 else "S"
        gps[GPS.GPSLatitude] = _sexagesimal(abs(priors.latitude_deg))
        gps[GPS.GPSLongitudeRef] = "E" if priors.longitude_deg >= 0 else "W"
        gps[GPS.GPSLongitude] = _sexagesimal(abs(priors.longitude_deg))
        if priors.altitude_m is not None:
            gps[GPS.GPSAltitudeRef] = b"\0" if priors.altitude_m >= 0 else b"\1"
            gps[GPS.GPSAltitude] = abs(priors.altitude_m)
    numbers = {
        "GimbalYawDegree": priors.yaw_deg,
        "GimbalPitchDegree": priors.pitch_deg,
        "GimbalRollDegree": priors.roll_deg,
        "RelativeAltitude": priors.height_above_takeoff_m,
    }
    known = [f'drone-dji:{name}="{value:+.2f}"' for name, value in numbers.items() if value is not None]
    return PriorTags(exif, _XMP.format(" ".join(known)).encode() if known else b"")


def _sexagesimal(degrees: float) -> tuple[float, float, float]:
    minutes, whole = math.modf(degrees)
    seconds, minutes = math.modf(minutes * 60.0)
    return whole, minutes, seconds * 60.0
