"""Client of the fvs service: upload images, update the model, rank the next views to photograph.

``Client`` blocks; ``AsyncClient`` has the same methods for ``await``.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fvs_client.exports import *  # noqa: F403 -- as they are listed there
    from fvs_client.exports import __all__ as __all__


def __getattr__(name: str) -> Any:
    """Import the client when one of its names is first used; the spool uses none of them."""
    # Not `from fvs_client import exports`, which would ask here for `exports`.
    exports = import_module("fvs_client.exports")
    if name == "__all__" or name in exports.__all__:
        return getattr(exports, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *import_module("fvs_client.exports").__all__})
