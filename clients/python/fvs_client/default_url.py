"""The URL of the service by default."""

DEFAULT_URL = "http://127.0.0.1:8000"
