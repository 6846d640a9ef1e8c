"""Bytes on the wire, both ways, of what a vehicle does: send a photograph, ask for the next view.

python benchmarks/wire_bytes.py

All goes through Caddy with the configuration of `deploy/proxy`. A relay between client and proxy counts what
TCP carries, TLS and its handshakes included, without the headers of TCP and IP. A client's connection is open
when it ranks; the first request on it is a row of its own.
"""

import argparse
import io
import json
import os
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path

import grpc
import numpy as np
from fvs.v1.scenes_pb2 import GetSceneRequest
from fvs.v1.scenes_pb2_grpc import SceneServiceStub
from fvs.v1.views_pb2 import RankViewsRequest
from fvs.v1.views_pb2_grpc import ViewServiceStub
from fvs_client import Candidate, Client, Orbit
from fvs_service.serving.running import running_service
from PIL import Image
from rich.console import Console
from rich.table import Table
from service_ranking import photographs_of_a_courtyard, scene_with_model

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "servers"))
from proxy_server import running_proxy

Rows = dict[str, tuple[int, int]]
"""What was done → bytes up and down."""


class CountingRelay:
    """Passes TCP on to ``port`` of this machine, and counts."""

    def __init__(self, port: int) -> None:
        self._target = ("127.0.0.1", port)
        self._server = socket.create_server(("127.0.0.1", 0))
        self.address = f"localhost:{self._server.getsockname()[1]}"
        self.up = self.down = 0
        threading.Thread(target=self._accept, daemon=True).start()

    def close(self) -> None:
        """Accept no more connections."""
        self._server.close()

    def counted(self, action: Callable[[], object]) -> tuple[int, int]:
        """Bytes up and down that ``action`` takes."""
        before = self.up, self.down
        action()
        return self.up - before[0], self.down - before[1]

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._server.accept()
            except OSError:
                return
            far = socket.create_connection(self._target)
            threading.Thread(target=self._pass, args=(near, far, True), daemon=True).start()
            threading.Thread(target=self._pass, args=(far, near, False), daemon=True).start()

    def _pass(self, source: socket.socket, target: socket.socket, up: bool) -> None:
        try:
            while data := source.recv(65_536):
                if up:
                    self.up += len(data)
                else:
                    self.down += len(data)
                target.sendall(data)
            target.shutdown(socket.SHUT_WR)
        except OSError:
            pass


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--size", type=int, default=2_000_000, help="bytes of the photograph")
    parser.add_argument("--candidates", type=int, default=50)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rows: Rows = {}
    with tempfile.TemporaryDirectory(prefix="fvs-wire-") as name:
        folder = Path(name)
        photographs = photographs_of_a_courtyard(folder / "courtyard")
        with (
            running_service(folder / "service", folder / "service.log") as service,
            running_proxy(folder / "proxy", service.url, service.rpc_url) as proxy,
        ):
            os.environ["SSL_CERT_FILE"] = str(proxy.authority)
            with Client(service.url) as direct:
                scene, _ = scene_with_model(direct, photographs)
                empty = direct.scenes.create("photographs").id
            with closing(CountingRelay(proxy.port)) as relay:
                _measure_photographs(rows, relay, empty, folder, options.size)
                _measure_views(rows, relay, scene.id, options.candidates)
                _measure_calls(rows, relay, proxy.authority, scene.id, options.candidates)
    table = Table("what", "up, B", "down, B")
    for what, (up, down) in rows.items():
        table.add_row(what, f"{up:,}", f"{down:,}")
    Console().print(table)
    if options.json:
        options.json.write_text(
            json.dumps({what: {"up": up, "down": down} for what, (up, down) in rows.items()})
        )


def _measure_photographs(rows: Rows, relay: CountingRelay, scene_id: str, folder: Path, size: int) -> None:
    url = f"https://{relay.address}"
    spooled, put = folder / "spooled", folder / "put"
    for number, place in enumerate((spooled, put)):
        place.mkdir()
        (place / "photograph.jpg").write_bytes(_photograph(number, size))
    program = [str(Path(sys.executable).with_name("fvs-client")), "--url", url, "spool"]
    subprocess.run(
        [*program, "add", "--scene", scene_id, str(spooled / "photograph.jpg")],
        check=True,
        capture_output=True,
    )

    def send() -> None:
        subprocess.run([*program, "send", str(spooled)], check=True, capture_output=True)

    rows[f"photograph of {size:,} B, by the spool"] = relay.counted(send)
    with Client(url) as client:
        scene = client.scenes.get(scene_id)
        rows[f"photograph of {size:,} B, by the client"] = relay.counted(lambda: scene.images.upload(put))


def _measure_views(rows: Rows, relay: CountingRelay, scene_id: str, count: int) -> None:
    with Client(f"https://{relay.address}") as client:
        rows["REST: connect, get the scene"] = relay.counted(lambda: client.scenes.get(scene_id))
        scene = client.scenes.get(scene_id)
        orbit = Orbit(count=count)
        listed = [Candidate(id=item.id, pose=item.pose) for item in scene.rank(generator=orbit).candidates]
        asked: dict[str, Callable[[], object]] = {
            f"ranking of an orbit of {count}": lambda: scene.rank(generator=orbit),
            f"ranking of an orbit of {count}, the first of it": lambda: scene.rank(generator=orbit, top_k=1),
            f"ranking of {count} listed candidates": lambda: scene.rank(listed),
            f"ranking of {count} listed candidates, the first of it": lambda: scene.rank(listed, top_k=1),
        }
        for what, ask in asked.items():
            rows[f"REST: {what}"] = relay.counted(ask)


def _measure_calls(rows: Rows, relay: CountingRelay, authority: Path, scene_id: str, count: int) -> None:
    credentials = grpc.ssl_channel_credentials(authority.read_bytes())
    with grpc.secure_channel(relay.address, credentials) as channel:
        scenes, views = SceneServiceStub(channel), ViewServiceStub(channel)
        asked = GetSceneRequest(scene_id=scene_id)
        rows["gRPC: connect, get the scene"] = relay.counted(lambda: scenes.GetScene(asked))
        orbit = {"generator": {"orbit": {"count": count}}}
        ranked = views.RankViews(RankViewsRequest(scene_id=scene_id, ranking=orbit)).candidates
        listed = {"candidates": {"items": [{"id": one.id, "pose": one.pose} for one in ranked]}}
        for what, ranking in ((f"an orbit of {count}", orbit), (f"{count} listed candidates", listed)):
            for more, top in (("", {}), (", the first of it", {"top_k": 1})):
                request = RankViewsRequest(scene_id=scene_id, ranking={**ranking, **top})
                rows[f"gRPC: ranking of {what}{more}"] = relay.counted(partial(views.RankViews, request))


def _photograph(seed: int, size: int) -> bytes:
    """A photograph that is readable, and padded after its end to ``size`` bytes of noise."""
    content = io.BytesIO()
    noise = np.random.default_rng(seed)
    Image.fromarray(noise.integers(0, 256, (480, 640, 3), dtype=np.uint8)).save(
        content, format="JPEG", quality=90
    )
    return content.getvalue() + noise.bytes(size - content.tell())


if __name__ == "__main__":
    main()
