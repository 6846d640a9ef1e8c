"""The rule when requests need an API key, in words for the operator."""

from fvs_service.application import Storage, open_storage
from fvs_service.errors import ForbiddenError
from fvs_service.settings import Settings


def access_of(storage: Storage) -> str:
    """A sentence that says whether requests need an API key, and why.

    Raises ``ForbiddenError`` when they do, and there is none that is valid.
    """
    settings = storage.settings
    if not storage.keys.required:
        if settings.require_keys is None:
            return "Requests need no API key until one is created."
        return "Requests need no API key: FVS_REQUIRE_KEYS is false."
    if settings.require_keys:
        reason = "FVS_REQUIRE_KEYS is true"
    elif settings.remote_hosts:
        reason = f"other machines may reach the service as {' or '.join(settings.remote_hosts)}"
    else:
        reason = "keys were created"
    if not any(key.valid for key in storage.keys.all()):
        raise ForbiddenError(
            f"Requests need an API key, because {reason}, and no key is valid.",
            hint="Create one: fvs keys create NAME. With FVS_REQUIRE_KEYS=false, whoever can reach the "
            "service may use it without a key.",
        )
    return f"Requests need an API key: {reason}."


def require_protection(settings: Settings) -> str:
    """``access_of`` the storage of ``settings``, which is made if it does not exist."""
    with open_storage(settings) as storage:
        return access_of(storage)
