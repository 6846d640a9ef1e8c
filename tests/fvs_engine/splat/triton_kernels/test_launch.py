"""Every kernel is launched as on a device, in a process without Triton's interpreter."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = Path(__file__).parents[4] / "benchmarks" / "gpu" / "launch.py"


@pytest.mark.process
@pytest.mark.system
def test_launchers_give_what_the_compiler_takes():
    environment = {key: value for key, value in os.environ.items() if key != "TRITON_INTERPRET"}
    environment["TRITON_DEFAULT_FP_FUSION"] = "1"
    child = [sys.executable, "-W", "ignore", PROGRAM]
    printed = subprocess.run(child, env=environment, check=True, stdout=subprocess.PIPE, text=True).stdout
    variants = json.loads(printed)["variants"]
    assert {"project_kernel", "_blend_backward", "adam", "ssim_rows", "count_digits"} <= variants.keys()
    assert max(variants.values()) <= 8, "a device would compile them one after the other"
