"""Where a gateway listens, which it reports to its supervisor."""

from urllib.parse import urlsplit

from fvs_engine.records import Record


class Addresses(Record):
    """Where the gateway listens: its URL, and the port of gRPC, None without it."""

    url: str
    rpc_port: int | None

    @property
    def rpc_url(self) -> str | None:
        """The address of gRPC, as ``grpc://host:port``, or ``grpcs`` with TLS."""
        if self.rpc_port is None:
            return None
        parts = urlsplit(self.url)
        scheme = "grpcs" if parts.scheme == "https" else "grpc"
        return f"{scheme}://{parts.netloc.rpartition(':')[0]}:{self.rpc_port}"
