"""``fvs-client rank``."""

from pathlib import Path
from typing import Annotated

import typer

from fvs_client import Ranking
from fvs_client.cli.ground import GroundOption, ground_of
from fvs_client.cli.options import (
    AimOption,
    AnswerTimeoutOption,
    CandidatesOption,
    ForVehicleOption,
    JsonOption,
    LevelOption,
    MethodOption,
    NoFlyOption,
    SceneArgument,
    SnapshotOption,
    VolumeOption,
    YesOption,
)
from fvs_client.cli.output import print_json, print_table
from fvs_client.cli.poses import (
    GENERATOR,
    FrameOption,
    RankingGenerator,
    generator_asked,
    read_candidates,
    read_pose,
    read_volume,
)
from fvs_client.cli.progress import ranking_progress
from fvs_client.cli.session import confirm, find_scene, service
from fvs_client.models.rankings import made_by, ranking_table

rankings = typer.Typer(help="List, show and delete rankings.", no_args_is_help=True)

_RankingArgument = Annotated[str, typer.Argument(metavar="RANKING", help="A ranking's id.")]


def rank(
    context: typer.Context,
    scene: SceneArgument,
    candidates: CandidatesOption = None,
    generator: Annotated[RankingGenerator | None, GENERATOR] = None,
    count: Annotated[
        int | None,
        typer.Option(min=1, max=2_000, help="Number of candidates for orbit, around-current and --volume."),
    ] = None,
    volume: VolumeOption = None,
    aim: AimOption = None,
    level: LevelOption = False,
    safety: Annotated[
        float | None,
        typer.Option(
            min=0,
            max=2e7,
            metavar="M",
            help="Least distance from anything in the model.",
            show_default="half of that from which the nearest photographs saw it",
        ),
    ] = None,
    no_fly: NoFlyOption = None,
    terrain: GroundOption = None,
    rank_all: Annotated[
        bool,
        typer.Option(
            "--all", help="Rank also candidates in matter, too close to it, or unlikely to be registered."
        ),
    ] = False,
    method: MethodOption = "median-frequency",
    current: Annotated[
        Path | None,
        typer.Option(exists=True, dir_okay=False, metavar="FILE", help="JSON: the current pose."),
    ] = None,
    radius: Annotated[
        float | None,
        typer.Option(min=0, max=1e9, metavar="M", help="Rank only candidates within M of the current pose."),
    ] = None,
    frame: FrameOption = None,
    top: Annotated[
        int | None, typer.Option(min=1, max=100_000, metavar="K", help="Show only the first K candidates.")
    ] = None,
    snapshot: SnapshotOption = None,
    budget: Annotated[
        int,
        typer.Option(
            min=1,
            max=10_000,
            help="Number of photographs still to be taken, for which kriging and uniform plan.",
        ),
    ] = 1,
    seed: Annotated[int, typer.Option(min=0, max=2**31 - 1, help="Seed of the method random.")] = 0,
    for_vehicle: ForVehicleOption = None,
    renders: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Save the render and the spectrum of every candidate of the answer."
        ),
    ] = None,
    timeout: AnswerTimeoutOption = None,
    as_json: JsonOption = False,
) -> None:
    """Rank candidates for the next view, best first."""
    if radius is not None and current is None:
        raise typer.BadParameter("--radius needs --current.")
    chosen = generator_asked(candidates, generator, count, volume, aim, level=level)
    listed = read_candidates(candidates)
    current_pose = None if current is None else read_pose(current)
    with service(context, as_json=as_json) as client:
        found = find_scene(client, scene)
        if renders is not None:
            renders.mkdir(parents=True, exist_ok=True)  # before a ranking is made for nothing
        with ranking_progress(as_json=as_json) as on_scored:
            ranking = found.rank(
                listed,
                generator=chosen,
                current_pose=current_pose,
                radius_m=radius,
                safety_m=safety,
                no_fly=[read_volume(path) for path in no_fly] if no_fly else None,
                terrain=ground_of(terrain, found, listed or ()),
                rank_all=rank_all,
                frame=None if frame is None else frame.value,
                top_k=top,
                method=method,
                snapshot_id=snapshot,
                budget=budget,
                seed=seed,
                for_vehicle=for_vehicle,
                timeout_s=timeout,
                on_scored=on_scored,
            )
        if renders is not None:
            _save_renders(ranking, renders)
    if as_json:
        print_json(ranking.model_dump(mode="json"))
    else:
        _print(ranking)
        if renders is not None:
            typer.echo(f"{len(ranking.candidates)} renders and spectra are in {renders}")


@rankings.command("list")
def list_all(context: typer.Context, scene: SceneArgument, as_json: JsonOption = False) -> None:
    """List the rankings of a scene, newest first."""
    with service(context, as_json=as_json) as client:
        found = list(find_scene(client, scene).rankings.list())
    if as_json:
        print_json([item.model_dump(mode="json") for item in found])
        return
    print_table(
        ("id", "method", "generator", "candidates", "best", "snapshot", "created"),
        [
            (
                item.id,
                item.method,
                item.generator or "",
                str(item.total),
                item.best or "",
                item.snapshot_id,
                item.created_at.strftime("%F %H:%M"),
            )
            for item in found
        ],
        right_aligned=("candidates",),
    )


@rankings.command("show")
def show(context: typer.Context, ranking: _RankingArgument, as_json: JsonOption = False) -> None:
    """Show a ranking."""
    with service(context, as_json=as_json) as client:
        found = client.rankings.get(ranking)
    if as_json:
        print_json(found.model_dump(mode="json"))
    else:
        _print(found)


@rankings.command("delete")
def delete(context: typer.Context, ranking: _RankingArgument, yes: YesOption = False) -> None:
    """Delete a ranking with its renders."""
    with service(context, as_json=False) as client:
        found = client.rankings.get(ranking)
        confirm(f"Permanently delete the ranking {found.id}?", yes=yes)
        found.delete()
    typer.echo(f"{found.id} deleted")


def _print(ranking: Ranking) -> None:
    table = ranking_table(ranking)
    print_table(table.headings, table.rows, right_aligned=table.right_aligned)
    typer.echo(made_by(ranking))
    for warning in ranking.warnings:
        typer.echo(f"Warning: {warning.message} {warning.hint}", err=True)


def _save_renders(ranking: Ranking, folder: Path) -> None:
    for number, item in enumerate(ranking.candidates, start=1):
        (folder / f"{number:04d}-{item.id}-render.png").write_bytes(ranking.render(item))
        (folder / f"{number:04d}-{item.id}-spectrum.png").write_bytes(ranking.spectrum(item))
