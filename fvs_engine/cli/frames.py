"""The command ``fvs frames``: frames of a video as photographs."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fvs_engine.cli.options import JsonOption, OutOption

if TYPE_CHECKING:
    from fvs_engine.monitor import Monitor


def frames(
    video: Annotated[Path, typer.Argument(metavar="VIDEO", help="A video: MP4, MOV, MKV …")],
    out: OutOption,
    every: Annotated[
        float, typer.Option(min=0.02, max=3600.0, metavar="S", help="Spacing of the frames in seconds.")
    ] = 1.0,
    as_json: JsonOption = False,
) -> None:
    """Take sharp frames from a video: photographs for `fvs reconstruct` and `fvs-client upload`.

    A file's name has its time in the video. Its EXIF and XMP have the position, attitude and time of day that
    DJI's subtitles (VIDEO.SRT, or in the video) or GoPro's metadata have. Needs the extra `video`.
    """
    try:
        from fvs_engine.video.extract import extract_frames
    except ModuleNotFoundError as error:
        raise typer.BadParameter(
            "Videos need PyAV: install fvs with the extra `video`.", param_hint="VIDEO"
        ) from error
    from fvs_engine.cli import report
    from fvs_engine.cli.jobs import run_job

    def job(monitor: "Monitor") -> list[Path]:
        return extract_frames(video, out, every, monitor)

    report.show_files(run_job(job, machine=as_json), machine=as_json)
