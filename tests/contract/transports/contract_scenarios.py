"""What scenarios share: poses, models, and the check of a refusal."""

from collections.abc import Callable
from typing import Any

from fvs_schema.scenes import Alignment

Compare = Callable[[Callable[[Any], None]], None]
LOOK = {"frame": "world", "position": [0.0, 0.0, -4.0], "orientation_wxyz": [1.0, 0.0, 0.0, 0.0]}
ORIGIN = {"latitude_deg": 48.3014, "longitude_deg": 7.2511, "altitude_m": 412.0}


def refused(outcome: Any, code: str) -> Any:
    assert outcome.code == code, outcome
    assert outcome.message
    return outcome


def model_of(tenant: Any, scene: str, alignment: Alignment | None = None) -> str:
    snapshot: str = tenant.gateway.model(scene, headers=tenant.headers, alignment=alignment, seed=7)
    return snapshot
