"""The URL of the service."""

DEFAULT_URL = "http://127.0.0.1:8000"


def base_url(url: str | None) -> str:
    """``url``, or the default one, without the slash and the ``/v1`` that requests add."""
    return (url or DEFAULT_URL).rstrip("/").removesuffix("/v1").rstrip("/")
