"""The runner's listener: it accepts connections and serves those that begin with the secret.

Other machines can reach it, so what has not sent the secret may cost neither descriptors, threads nor room in
the log without limit, and no failure ends it: a runner that accepts nothing would keep its lease for ever.
"""

import contextlib
import hmac
import json
import logging
import socket
import threading
import time
from collections.abc import Callable

from fvs_service.host.protocol.connection import Connection, RunnerGoneError

_BACKLOG = 128
_GREETING_S, _GREETING_BYTES = 5.0, 200
_STRANGERS = 32
"""Maximum number of connections that are not authenticated yet; one more closes the oldest."""
_PAUSE_S = 0.2
_LOG_EVERY_S = 60.0

_log = logging.getLogger(__name__)


class Listener:
    """Accepts connections at a free port of ``address``, a host name or IP address of this machine.

    ``serve`` is called for each in a thread of its own.
    """

    def __init__(self, address: str, secret: str, serve: Callable[[Connection], None]) -> None:
        self._secret = secret
        self._serve = serve
        self._strangers: list[Connection] = []  # the oldest first
        self._lock = threading.Lock()
        self._failed = _RareWarning("Connections cannot be accepted")
        self._refused = _RareWarning("Connections did not begin with the secret")
        (family, _, _, _, (host, *_)), *_ = socket.getaddrinfo(address, None, type=socket.SOCK_STREAM)
        self._socket = socket.create_server((str(host), 0), family=family, backlog=_BACKLOG)

    @property
    def address(self) -> tuple[str, int]:
        """Host and port."""
        host, port = self._socket.getsockname()[:2]
        return host, port

    def listen(self) -> None:
        """Accept connections until the socket is closed."""
        while self._socket.fileno() >= 0:
            try:
                self._accept()
            except (OSError, RuntimeError) as error:  # no descriptor, or no thread, is left for a while
                self._failed.log(str(error))
                time.sleep(_PAUSE_S)

    def _accept(self) -> None:
        accepted, _ = self._socket.accept()
        with contextlib.ExitStack() as undo:
            undo.callback(accepted.close)
            connection = Connection(accepted)
            undo.callback(connection.close)
            threading.Thread(target=self._receive, args=(connection,), daemon=True).start()
            undo.pop_all()

    def _receive(self, connection: Connection) -> None:
        try:
            if self._is_known(connection):
                self._serve(connection)
            else:
                self._refused.log()
        finally:
            connection.close()

    def _is_known(self, connection: Connection) -> bool:
        """Whether the first line is the secret; it must arrive within seconds."""
        with self._lock:
            self._strangers.append(connection)
            if len(self._strangers) > _STRANGERS:
                self._strangers.pop(0).end()
        try:
            greeting = json.loads(connection.receive_first_line(_GREETING_BYTES, _GREETING_S))
            secret = greeting.get("secret", "") if isinstance(greeting, dict) else ""
            return hmac.compare_digest(str(secret).encode(), self._secret.encode())
        except (RunnerGoneError, ValueError):
            return False
        finally:
            with self._lock:
                if connection in self._strangers:
                    self._strangers.remove(connection)


class _RareWarning:
    """A line of the log for many equal events: at most one a minute, with their number."""

    def __init__(self, sentence: str) -> None:
        self._sentence = sentence
        self._lock = threading.Lock()
        self._count = 0
        self._from = 0.0

    def log(self, reason: str = "") -> None:
        """Count one event, and log it unless that was done a moment ago."""
        with self._lock:
            self._count += 1
            if time.monotonic() < self._from:
                return
            count, self._count, self._from = self._count, 0, time.monotonic() + _LOG_EVERY_S
        _log.warning("%s (%d times since the last such line). %s", self._sentence, count, reason)
