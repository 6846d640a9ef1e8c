"""Photographs through a bad link: what arrives, how many bytes it takes, and how long.

python benchmarks/spool_link.py                        the spool, killed 20 times, the gateway 5 times
python benchmarks/spool_link.py --whole --photographs 5    whole files, sent again until they arrive

The link is that of ``tests/servers/link_simulator.py``: 20 kB/s, and half of the requests are answered 5xx.
Time runs ``--faster``: the rate, the gaps and the spool's pauses and timeouts are scaled, sizes are not.
"""

import argparse
import http.client
import io
import json
import os
import random
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections import Counter
from hashlib import sha256
from pathlib import Path

import httpx2
import numpy as np
from fvs_client.spool import Settings, Spool
from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests" / "servers"))

from link_simulator import LinkQuality, LinkSimulator

_GATEWAY = b"fvs_service.serving.process\0gateway"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--photographs", type=int, default=200)
    parser.add_argument("--size", type=int, default=2_000_000, help="bytes of a photograph")
    parser.add_argument("--rate", type=float, default=20_000.0, help="bytes per second")
    parser.add_argument("--latency", type=float, default=0.3, help="s in each direction")
    parser.add_argument("--breaks-every", type=float, default=500_000.0, help="bytes, the mean")
    parser.add_argument("--failing", type=float, default=0.5, help="share of requests that are answered 5xx")
    parser.add_argument("--gap-every", type=float, default=1_800.0, help="s with a link, then")
    parser.add_argument("--gap", type=float, default=300.0, help="s without")
    parser.add_argument("--faster", type=float, default=40.0, help="how much faster time runs")
    parser.add_argument("--whole-requests-only", action="store_true", help="a proxy passes on only those")
    parser.add_argument("--client-kills", type=int, default=20)
    parser.add_argument("--gateway-kills", type=int, default=5)
    parser.add_argument("--port", type=int, default=8941)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--whole", action="store_true", help="send whole files until they arrive")
    parser.add_argument("--spool", nargs=3, metavar=("URL", "SCENE", "FOLDER"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.spool:
        _spool(*options.spool, options.faster)
        return
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "DCIM").mkdir()
        _experiment(options, Path(folder))


def _experiment(options: argparse.Namespace, folder: Path) -> None:
    for number in range(options.photographs):
        (folder / "DCIM" / f"DJI_{number:04d}.JPG").write_bytes(_photograph(number, options.size))
    quality = LinkQuality(
        rate_bytes_s=options.rate * options.faster,
        latency_s=options.latency / options.faster,
        breaks_every_bytes=options.breaks_every,
        failing_share=options.failing,
        whole_requests_only=options.whole_requests_only,
        gap_every_s=options.gap_every / options.faster,
        gap_s=options.gap / options.faster,
    )
    serve = [str(Path(sys.executable).with_name("fvs")), "serve", "--root", str(folder / "service")]
    serve += ["--port", str(options.port), "--role", "gateway", "--no-grpc"]
    with (
        (folder / "service.log").open("w") as log,
        subprocess.Popen(serve, stderr=log, stdout=log) as service,
    ):
        try:
            with httpx2.Client(base_url=f"http://127.0.0.1:{options.port}", timeout=60) as direct:
                _wait_for_service(direct)
                scene = direct.post("/v1/scenes", json={"name": "field"}).json()["id"]
                begun = time.monotonic()
                with LinkSimulator(options.port, quality, options.seed) as link:
                    send = _send_whole if options.whole else _send_by_spool
                    kills = send(options, link, scene, folder / "DCIM", service.pid)
                    elapsed_s = time.monotonic() - begun
                _report(options, link, _images(direct, scene), folder / "DCIM", kills, elapsed_s)
        finally:
            service.terminate()


def _send_by_spool(
    options: argparse.Namespace, link: LinkSimulator, scene: str, folder: Path, service: int
) -> Counter[str]:
    """Run the spool until all is sent; kill it and the gateway as the photographs arrive."""
    rng = random.Random(options.seed)
    plan = [(rng.uniform(0.01, 0.97), "client") for _ in range(options.client_kills)]
    plan += [(rng.uniform(0.01, 0.97), "gateway") for _ in range(options.gateway_kills)]
    plan.sort()
    kills: Counter[str] = Counter()
    command = [
        sys.executable,
        __file__,
        "--faster",
        str(options.faster),
        "--spool",
        link.url,
        scene,
        str(folder),
    ]
    client = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    total = options.photographs * options.size
    try:
        while True:
            time.sleep(0.2)
            arrived, ended = _progress(folder)
            if ended == options.photographs:
                return kills
            while plan and arrived >= plan[0][0] * total:
                _, target = plan.pop(0)
                time.sleep(rng.uniform(0.0, 2.0))
                if target == "client":
                    client.kill()
                    client.wait()
                    client = subprocess.Popen(command, stderr=subprocess.DEVNULL)
                    kills[target] += 1
                else:
                    kills[target] += _kill_gateway(service)
    finally:
        client.send_signal(signal.SIGTERM)
        client.wait()


def _spool(url: str, scene: str, folder: str, faster: float) -> None:
    usual = Settings()
    settings = Settings(
        settle_s=usual.settle_s / faster,
        look_every_s=usual.look_every_s / faster,
        timeout_s=max(1.0, usual.timeout_s / faster),
        first_pause_s=usual.first_pause_s / faster,
        longest_pause_s=usual.longest_pause_s / faster,
    )
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    Spool(folder, scene, url=url, settings=settings).run()


def _send_whole(
    options: argparse.Namespace, link: LinkSimulator, scene: str, folder: Path, _service: int
) -> Counter[str]:
    """Send each file as a form until the answer is 2xx."""
    rng = random.Random(options.seed)
    for file in sorted(folder.glob("*.JPG")):
        content = file.read_bytes()
        head = f'--x\r\nContent-Disposition: form-data; name="file"; filename="{file.name}"\r\n\r\n'
        body = head.encode() + content + b"\r\n--x--\r\n"
        failures = 0
        while True:
            connection = http.client.HTTPConnection("127.0.0.1", link.port, timeout=30)
            try:
                kind = {"Content-Type": "multipart/form-data; boundary=x"}
                connection.request("POST", f"/v1/scenes/{scene}/images", body, kind)
                if connection.getresponse().status < 300:
                    break
            except (OSError, http.client.HTTPException):
                pass
            finally:
                connection.close()
            time.sleep(rng.random() * min(60.0, 0.5 * 2.0**failures) / options.faster)
            failures = min(failures + 1, 8)
    return Counter()


def _progress(folder: Path) -> tuple[int, int]:
    """Bytes that have arrived, and photographs that were sent or refused, by the outbox."""
    try:
        database = sqlite3.connect(f"file:{folder / '.fvs-spool.sqlite3'}?mode=ro", uri=True, timeout=30)
        query = "SELECT total(offset_bytes), total(state IN ('sent', 'refused')) FROM photographs"
        arrived, ended = database.execute(query).fetchone()
        database.close()
    except sqlite3.OperationalError:  # not made yet
        return 0, 0
    return arrived, ended


def _kill_gateway(supervisor: int) -> int:
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
            if parent == supervisor and _GATEWAY in (folder / "cmdline").read_bytes():
                os.kill(int(folder.name), signal.SIGKILL)
                return 1
        except OSError:
            continue
    return 0


def _images(direct: httpx2.Client, scene: str) -> list[dict[str, object]]:
    _wait_for_service(direct)
    images: list[dict[str, object]] = []
    after: dict[str, str] = {}
    while True:
        page = direct.get(f"/v1/scenes/{scene}/images", params={"limit": "1000", **after}).json()
        images += page["items"]
        if page["next"] is None:
            return images
        after = {"after": page["next"]}


def _report(
    options: argparse.Namespace,
    link: LinkSimulator,
    images: list[dict[str, object]],
    folder: Path,
    kills: Counter[str],
    elapsed_s: float,
) -> None:
    digests = [f"sha256:{sha256(file.read_bytes()).hexdigest()}" for file in sorted(folder.glob("*.JPG"))]
    size = sum(file.stat().st_size for file in folder.glob("*.JPG"))
    result = {
        "photographs": len(digests),
        "arrived_once": Counter(str(image["digest"]) for image in images) == Counter(digests),
        "accepted": sum(image["verdict"] == "accepted" for image in images),
        "bytes": size,
        "bytes_up": link.sent_bytes["up"],
        "bytes_down": link.sent_bytes["down"],
        "up_per_byte": round(link.sent_bytes["up"] / size, 4),
        "events": dict(link.events),
        "kills": dict(kills),
        "elapsed_s": round(elapsed_s),
        "elapsed_unscaled_h": round(elapsed_s * options.faster / 3600, 1),
    }
    print(json.dumps(result, indent=2))


def _wait_for_service(direct: httpx2.Client) -> None:
    for _ in range(600):
        try:
            if direct.get("/livez").status_code == 200:
                return
        except httpx2.TransportError:
            pass
        time.sleep(0.1)
    raise SystemExit("The service does not start.")


def _photograph(seed: int, size: int) -> bytes:
    """A JPEG of noise, of exactly ``size`` bytes."""
    side = int((size / 1.75) ** 0.5)
    while True:
        pixels = np.random.default_rng(seed).integers(0, 256, (side, side, 3), dtype=np.uint8)
        out = io.BytesIO()
        Image.fromarray(pixels).save(out, "JPEG", quality=90)
        content = out.getvalue()
        if len(content) <= size - 4:
            break
        side = int(side * 0.98)
    missing = size - len(content)
    comments = b""
    while missing:
        length = min(missing, 65_000)
        length = missing - 4 if 0 < missing - length < 4 else length
        comments += b"\xff\xfe" + (length - 2).to_bytes(2) + bytes(length - 4)
        missing -= length
    return content[:2] + comments + content[2:]


if __name__ == "__main__":
    main()
