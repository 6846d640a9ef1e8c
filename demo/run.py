"""The demonstration, ``make demo``: from photographs to ranked next views, as a client of the service.

Starts the service, uploads photographs (of a simulated courtyard if none are given), updates the model, ranks
candidates, and writes the results into one folder. The console shows the scene meanwhile, and with ``--keep``
until Ctrl-C.
"""

import argparse
import json
import signal
import subprocess
import sys
import tempfile
import threading
import time
from functools import partial
from pathlib import Path

import numpy as np
from fvs_client import Client, Dataset, FvsError, ImageMetadata, Job, Orbit, Ranking, Scene, Snapshot
from fvs_client.cli.progress import display, job_progress, upload_progress
from fvs_client.uploads import Describe
from fvs_service.errors import ServiceError
from fvs_service.serving.running import running_service
from pictures import draw_contact_sheet, draw_trajectory
from rich.console import Console
from rich.table import Table

from fvs_engine.geometry.geodetic import GeodeticPosition, geodetic_from_enu

HOME = GeodeticPosition(47.3769, 8.5417, 440.0)
FVS = Path(sys.executable).with_name("fvs")
console = Console()
GENERATORS: dict[str, Orbit | Dataset] = {"orbit": Orbit(), "dataset": Dataset()}
"""A circle around the model, or halfway between neighbouring photographs."""


def main() -> None:
    """Run the demonstration with the arguments of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "photographs", nargs="?", type=Path, help="a folder; without it, photographs are simulated"
    )
    parser.add_argument("--out", type=Path, default=Path("out/demo"), help="where the results go")
    parser.add_argument("--iterations", type=int, default=1500, help="of training")
    parser.add_argument("--long-side", type=int, default=640, help="of the images in training, in px")
    parser.add_argument("--generator", choices=GENERATORS, help="generator of the candidates")
    parser.add_argument("--keep", action="store_true", help="leave the service running until Ctrl-C")
    options = parser.parse_args()
    for number in (signal.SIGINT, signal.SIGTERM):  # so that the service is stopped then, too
        signal.signal(number, lambda number, _: sys.exit(128 + number))
    if options.photographs is not None and not options.photographs.is_dir():
        missing = "is not a folder" if options.photographs.exists() else "does not exist"
        parser.error(f"{options.photographs} {missing}: give a folder of photographs")
    options.out.mkdir(parents=True, exist_ok=True)
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="fvs-demo-") as folder:
        photographs = options.photographs or _make_photographs(Path(folder))
        chosen = options.generator or ("orbit" if options.photographs is None else "dataset")
        try:
            with (
                running_service(Path(folder) / "service", options.out / "service.log") as service,
                Client(service.url) as client,
            ):
                scene = client.scenes.create("demonstration")
                page = f"{service.url}/#/scenes/{scene.id}"
                console.print(f"Watch it in a browser: {page}", soft_wrap=True)
                _send(scene, photographs, _positions(photographs) if options.photographs is None else None)
                job = _update(scene, options.iterations, options.long_side)
                ranking = scene.rank(generator=GENERATORS[chosen], frame="model")
                _print(ranking)
                snapshot = job.snapshot()
                assert snapshot is not None
                _leave(options.out, snapshot, ranking)
                if options.keep:
                    console.print(f"The scene stays open: {page}\nCtrl-C stops the service.", soft_wrap=True)
                    _wait_for_signal()
        except (FvsError, ServiceError) as error:
            raise SystemExit(
                f"{error}\n{error.hint}\nThe service's log is {options.out}/service.log"
            ) from error
    console.print(f"Done in {time.monotonic() - began:.0f} s; the service has been stopped.")


def _make_photographs(folder: Path) -> Path:
    """Simulate photographs along 0.6 of a turn around a courtyard; the ranking should prefer the rest."""
    console.print("No photographs were given: simulating some of a courtyard")
    command = [str(FVS), "simulate", str(folder / "courtyard"), "--images", "24", "--turns", "0.6"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return folder / "courtyard" / "images"


def _positions(photographs: Path) -> Describe:
    """Where simulated photographs were taken, as if the courtyard were ten times as large."""
    frames = json.loads((photographs.parent / "transforms.json").read_text())["frames"]
    metres = {
        Path(frame["file_path"]).name: [10.0 * row[3] for row in frame["transform_matrix"][:3]]
        for frame in frames
    }

    def describe(path: Path) -> ImageMetadata:
        position = geodetic_from_enu(np.array(metres[path.name]), HOME)
        return ImageMetadata(
            latitude_deg=position.latitude_deg,
            longitude_deg=position.longitude_deg,
            altitude_m=position.altitude_m,
        )

    return describe


def _wait_for_signal() -> None:
    stopping = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopping.set())
    stopping.wait()


def _send(scene: Scene, photographs: Path, describe: Describe | None) -> None:
    with display("Uploading photographs", as_json=False, in_bytes=True) as shown:
        report = scene.images.upload(
            photographs, on_progress=partial(upload_progress, shown), describe=describe
        )
    for file in (*report.failed, *report.rejected):
        console.print(f"  {file.path.name}: {file.image.reason if file.image else file.error}")
    again = scene.images.upload(photographs)
    console.print(f"Sent {report.bytes_sent / 1e6:.1f} MB; a second upload sent {again.bytes_sent} bytes")


def _update(scene: Scene, iterations: int, long_side_px: int) -> Job:
    with display("Updating the model", as_json=False) as shown:
        queued = scene.update(iterations=iterations, long_side_px=long_side_px)
        job = queued.wait(on_progress=partial(job_progress, shown))
    snapshot = job.snapshot()
    if snapshot is not None:
        metrics = snapshot.metrics
        console.print(
            f"The model: {metrics.registered} photographs registered, {metrics.unregistered} unregistered, "
            f"{metrics.gaussians:,} Gaussians after {metrics.iterations:,} iterations"
        )
    for warning in job.warnings:
        console.print(f"  {warning.message} {warning.hint}")
    return job


def _print(ranking: Ranking) -> None:
    console.print(f"Next views, by {ranking.request.method} in {ranking.seconds:.2f} s:")
    table = Table(box=None)
    for heading in ("rank", "id", "score", "coverage", "status"):
        table.add_column(heading, justify="left" if heading in ("id", "status") else "right")
    for item in ranking.candidates:
        score = "" if item.score is None else f"{item.score:.3f}"
        coverage = "" if item.coverage is None else f"{item.coverage:.0%}"
        table.add_row(str(item.rank or ""), item.id, score, coverage, item.status.value)
    console.print(table)


def _leave(out: Path, snapshot: Snapshot, ranking: Ranking) -> None:
    model = snapshot.download("point_cloud.ply", out)
    snapshot.download("cameras.json", out)
    (out / "ranking.json").write_text(ranking.model_dump_json(indent=1))
    if ranking.best is not None:
        draw_contact_sheet(out / "contact_sheet.png", ranking)
        draw_trajectory(out / "trajectory.png", snapshot.cameras(), ranking, model)
    console.print(f"Look at  {out}/contact_sheet.png   what the first candidates see, above their spectra")
    console.print(f"    and  {out}/trajectory.png      where they are, among the photographs, from above")
    console.print(f"Open     {out}/point_cloud.ply     in any splat viewer")


if __name__ == "__main__":
    main()
