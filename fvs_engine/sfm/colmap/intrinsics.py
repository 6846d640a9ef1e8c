"""Reading a calibration: COLMAP's ``cameras.txt`` with one camera, or the same in JSON."""

import json
from pathlib import Path

from pydantic import ValidationError

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.json_input import read_text
from fvs_engine.records import first_error
from fvs_engine.sfm.settings import KnownIntrinsics

_HINT = (
    "Write one line of COLMAP's cameras.txt, such as `1 PINHOLE 1920 1080 1500 1500 960 540`, or "
    '{"model": "PINHOLE", "width_px": 1920, "height_px": 1080, "params": [1500, 1500, 960, 540]}.'
)


def read_intrinsics(file: Path) -> KnownIntrinsics:
    """Read the one camera that ``file`` describes.

    JSON has the fields of ``KnownIntrinsics``; a line of ``cameras.txt`` is ``CAMERA_ID MODEL WIDTH HEIGHT
    PARAMS…``, comments begin with ``#``. Raises ``InvalidInputError``, naming the file, for anything else.
    """
    text = read_text(file, _HINT)
    try:
        fields = json.loads(text) if text.lstrip().startswith("{") else _fields_of_line(text)
        return KnownIntrinsics.model_validate(fields)
    except (json.JSONDecodeError, RecursionError) as error:
        raise InvalidInputError(f"{file} is not JSON: {error}.", hint=_HINT, path=file) from error
    except ValidationError as error:
        raise InvalidInputError(
            f"{file} does not describe a camera: {first_error(error)}.", hint=_HINT, path=file
        ) from error
    except InvalidInputError as error:
        raise InvalidInputError(f"{file}: {error.message}", hint=error.hint or _HINT, path=file) from error


def _fields_of_line(text: str) -> dict[str, object]:
    lines = [line.split() for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if len(lines) != 1:
        raise InvalidInputError(f"it describes {len(lines)} cameras, and one is needed.", hint=_HINT)
    _, model, width_px, height_px, *params = (*lines[0], *[""] * (4 - len(lines[0])))
    return {"model": model, "width_px": width_px, "height_px": height_px, "params": params}
