"""A runner's responses to a job."""

import queue
import threading
from typing import Any

from fvs_service.host.protocol.connection import RunnerError, RunnerGoneError, connect, exchange
from fvs_service.host.protocol.messages import RunJob

_CONNECT_S = 5.0


class JobResponses:
    """A runner's responses to a job, read by a thread into a queue."""

    def __init__(self, endpoint: str, request: RunJob) -> None:
        self._connection = connect(endpoint, _CONNECT_S)
        self._connection.set_timeout(None)
        self._received: queue.Queue[Any] = queue.Queue()
        threading.Thread(target=self._receive, args=(request,), daemon=True).start()

    def next(self, timeout_s: float) -> Any:
        """The next document, a ``Failure``, a ``RunnerGoneError``; None when there is none in time."""
        try:
            return self._received.get(timeout=timeout_s)
        except queue.Empty:
            return None

    def _receive(self, request: RunJob) -> None:
        try:
            for document in exchange(self._connection, request):
                self._received.put(document)
        except RunnerError as error:
            self._received.put(error.failure)
        except RunnerGoneError as error:
            self._received.put(error)
        finally:
            self._connection.close()
