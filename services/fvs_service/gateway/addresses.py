"""Where a gateway listens, which it reports to its supervisor."""

from urllib.parse import urlsplit

from fvs_engine.records import Record


class Addresses(Record):
    """Where the gateway listens: its URL, and the port of gRPC, None without it."""

    url: str
    rpc_port: int | None

    @property
    def rpc_url(self) -> str | None:
        """The address of gRPC, as ``grpc://host:port``."""
        if self.rpc_port is None:
            return None
        return f"grpc://{urlsplit(self.url).netloc.rpartition(':')[0]}:{self.rpc_port}"
