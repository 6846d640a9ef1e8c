import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_nothing_is_lost_when_anything_is_killed() -> None:
    """The default suite has a shorter form: ``tests/fvs_service/host/test_life_of_a_scene.py``."""
    script = Path(__file__).with_name("kill_anything.py")
    subprocess.run([sys.executable, str(script), "--kills", "12"], check=True, timeout=1800)
