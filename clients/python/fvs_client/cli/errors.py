"""Errors of the command line itself."""

from fvs_client.errors import FvsError
from fvs_schema.error_codes import ErrorCode


class SceneNameError(FvsError):
    """A scene's name is ambiguous, or taken."""

    code = ErrorCode.USAGE
