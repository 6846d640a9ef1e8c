"""Peak memory of an inspection: the worst small file of every accepted format, each in a process of its own.

The files are flat, so that they are small on the wire, and as large as the limits allow when decoded.

    python benchmarks/inspection_memory.py [--megapixels 128]
"""

import argparse
import io
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path

from fvs_service.images.inspection import inspect
from PIL import Image

from fvs_schema.service import Limits

Image.MAX_IMAGE_PIXELS = None
_MIB = 1 << 20


def _pillow(mode: str, image_format: str, **options: object) -> Callable[[int, int], bytes]:
    def make(width: int, height: int) -> bytes:
        color = {"I;16": 30_000, "L": 90, "LA": (90, 200), "P": 7}.get(mode, (90, 120, 60, 200)[: len(mode)])
        out = io.BytesIO()
        Image.new(mode, (width, height), color).save(out, image_format, **options)
        return out.getvalue()

    return make


def _png16(color_type: int, channels: int) -> Callable[[int, int], bytes]:
    """A PNG of 16 bits per channel, which Pillow does not write."""

    def make(width: int, height: int) -> bytes:
        import struct
        import zlib

        def chunk(name: bytes, data: bytes) -> bytes:
            return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

        packer = zlib.compressobj(9)
        row = b"\0" + b"\x55\x80" * (channels * width)
        data = b"".join(packer.compress(row) for _ in range(height)) + packer.flush()
        header = struct.pack(">IIBBBBB", width, height, 16, color_type, 0, 0, 0)
        return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", data) + chunk(b"IEND", b"")

    return make


def _turned(width: int, height: int) -> bytes:
    exif = Image.Exif()
    exif[0x0112] = 6
    return _pillow("RGB", "JPEG", exif=exif)(width, height)


FILES: Mapping[str, Callable[[int, int], bytes]] = {
    "JPEG": _pillow("RGB", "JPEG"),
    "JPEG, to be turned": _turned,
    "JPEG, progressive": _pillow("RGB", "JPEG", progressive=True, subsampling=0),
    "JPEG, CMYK, progressive": _pillow("CMYK", "JPEG", progressive=True),
    "PNG": _pillow("RGB", "PNG"),
    "PNG, RGBA": _pillow("RGBA", "PNG"),
    "PNG, 16-bit RGBA": _png16(6, 4),
    "PNG, 16-bit grey": _png16(0, 1),
    "PNG, grey and alpha": _pillow("LA", "PNG"),
    "TIFF, RGBA, deflated": _pillow("RGBA", "TIFF", compression="tiff_adobe_deflate"),
    "TIFF, one strip": _pillow("RGB", "TIFF", compression="tiff_adobe_deflate", tiffinfo={278: 1 << 20}),
    "TIFF, 16-bit grey": _pillow("I;16", "TIFF", compression="tiff_adobe_deflate"),
    "WebP": _pillow("RGB", "WEBP", method=0),
    "WebP, lossless, RGBA": _pillow("RGBA", "WEBP", lossless=True, method=0),
    "BMP, palette": _pillow("L", "BMP"),
}


def main() -> None:
    """Print a row of Markdown for each file."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--megapixels", type=float, default=128.0)
    parser.add_argument("--inspect", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--limits", default="{}", help="limits as JSON")
    arguments = parser.parse_args()
    limits = Limits.model_validate_json(arguments.limits)
    if arguments.inspect:
        _measure(arguments.inspect, limits)
        return
    print("| file | size | sides | bytes on the wire | verdict | peak memory | time |")
    print("|---|---|---|---|---|---|---|")
    for name, make in FILES.items():
        height = int((arguments.megapixels * 1e6 * 3 / 4) ** 0.5)
        width = int(arguments.megapixels * 1e6 / height)
        if name.startswith("WebP"):
            width, height = min(width, 16_383), min(height, 16_383)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "image"
            file.write_bytes(make(width, height))
            command = [sys.executable, __file__, "--inspect", str(file), "--limits", arguments.limits]
            answer = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
            print(
                f"| {name} | {width * height / 1e6:.0f} MP | {width}×{height} | "
                f"{file.stat().st_size / 1e6:.2f} MB | {answer['verdict']} | {answer['peak_mib']:.0f} MiB | "
                f"{answer['seconds']:.1f} s |",
                flush=True,
            )


def _measure(file: Path, limits: Limits) -> None:
    began = time.monotonic()
    found = inspect(file, limits.of_images)
    # Not getrusage: its maximum includes that of the process that started this one.
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    peak = (
        next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM")) * 1024 / _MIB
    )
    answer = {"verdict": found.verdict.value, "peak_mib": peak, "seconds": time.monotonic() - began}
    print(json.dumps(answer))


if __name__ == "__main__":
    main()
