"""Errors of the command line itself."""

from fvs_client.errors import FvsError


class SceneNameError(FvsError):
    """A scene's name is ambiguous, or taken."""
