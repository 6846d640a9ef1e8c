"""The spool of a camera: watches its folder and sends what it writes."""

import sys
import threading
from collections.abc import Callable
from pathlib import Path

from fvs_client.spool.connection import Target
from fvs_client.spool.draining import Drain
from fvs_client.spool.lock import only_sender
from fvs_client.spool.metadata import Describe
from fvs_client.spool.outbox import FILE_NAME, Outbox
from fvs_client.spool.settings import Settings
from fvs_client.spool.watching import Refuse, Watcher


class Spool:
    """Takes photographs of a folder into its outbox, and sends them to a scene.

    ``describe`` is called with the path of each photograph and returns what is known of it, or None; it
    overrides the sidecar. Those for which ``refuse`` returns a reason are not sent. Raises
    ``SpoolError`` where it cannot work at all.
    """

    def __init__(
        self,
        folder: str | Path,
        scene: str,
        *,
        url: str | None = None,
        api_key: str | None = None,
        outbox: str | Path | None = None,
        settings: Settings | None = None,
        describe: Describe | None = None,
        refuse: Refuse | None = None,
        say: Callable[[str], None] = lambda line: print(line, file=sys.stderr, flush=True),  # noqa: T201
    ) -> None:
        self._folder, self._scene = Path(folder), scene
        self._path = Path(folder) / FILE_NAME if outbox is None else Path(outbox)
        self._target = Target.resolve(url, api_key)
        self._settings = settings or Settings()
        self._describe, self._refuse, self._say = describe, refuse, say
        self._stop = threading.Event()
        self._failure: BaseException | None = None

    def stop(self) -> None:
        """End ``run`` from another thread, between two photographs."""
        self._stop.set()

    def run(self, begun: Callable[[], None] = lambda: None) -> None:
        """Watch and send until ``stop``; calls ``begun`` when no other process can send from the outbox."""
        with only_sender(self._path), Outbox(self._path) as outbox:
            watching = threading.Thread(target=self._watch, daemon=True)
            watching.start()
            begun()
            try:
                drain = Drain(outbox, self._target, self._settings, self._say)
                drain.run(self._stop, until_empty=False)
            finally:
                self._stop.set()
                watching.join()
        if self._failure is not None:
            raise self._failure

    def _watch(self) -> None:
        try:
            with Outbox(self._path) as outbox:
                watcher = Watcher(
                    self._folder,
                    self._scene,
                    outbox,
                    settle_s=self._settings.settle_s,
                    say=self._say,
                    describe=self._describe,
                    refuse=self._refuse,
                )
                while not self._stop.is_set():
                    watcher.look()
                    self._stop.wait(max(self._settings.look_every_s, watcher.rest_s))
        except BaseException as error:  # it must not end unseen
            self._failure = error
            self._stop.set()
