"""The rule that remote access needs keys."""

from fvs_service.application import open_storage
from fvs_service.errors import ForbiddenError
from fvs_service.settings import Settings


def require_protection(settings: Settings) -> None:
    """Raise ``ForbiddenError`` when keys are required and there is none."""
    if not settings.keys_required:
        return
    with open_storage(settings) as storage:
        if any(key.valid for key in storage.keys.all()):
            return
    if settings.loopback:
        raise ForbiddenError(
            "FVS_REQUIRE_KEYS is set, and there is no API key.",
            hint="Create one first: fvs keys create NAME.",
        )
    raise ForbiddenError(
        f"Programs on other machines can reach {settings.host}, and there is no API key.",
        hint="Create one first: fvs keys create NAME. Or listen on 127.0.0.1.",
    )
