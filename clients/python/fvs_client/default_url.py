"""Where the service is looked for when nothing says where it is."""

DEFAULT_URL = "http://127.0.0.1:8000"
