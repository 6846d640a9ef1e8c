"""``fvs-client visit`` and ``fvs-client visits``."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from fvs_client import Candidate, Client, Visit, VisitState
from fvs_client.cli.options import JsonOption, SceneArgument
from fvs_client.cli.output import print_json, print_table
from fvs_client.cli.poses import read_candidates
from fvs_client.cli.session import find_scene, service
from fvs_client.models.display import pose_text


def visit(
    context: typer.Context,
    scene: SceneArgument,
    state: Annotated[VisitState, typer.Argument(help="What the vehicle does about the views.")],
    vehicle: Annotated[str, typer.Option(metavar="NAME", help="Name of the vehicle, always the same one.")],
    ranking: Annotated[
        str | None, typer.Option(metavar="ID", help="The ranking whose candidates the views are.")
    ] = None,
    candidate: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ID",
            help="A candidate of the ranking; may be repeated.",
            show_default="the first-ranked one",
        ),
    ] = None,
    candidates: Annotated[
        Path | None,
        typer.Option(
            exists=True, dir_okay=False, metavar="FILE", help='Views as JSON: [{"id": …, "pose": {…}}, …].'
        ),
    ] = None,
    expires: Annotated[
        int, typer.Option(min=1, max=86_400, metavar="S", help="The report expires after S seconds.")
    ] = 600,
    as_json: JsonOption = False,
) -> None:
    """Report that a vehicle flies to views, took them or failed to: others are sent to other views."""
    if (ranking is None) == (candidates is None):
        raise typer.BadParameter("Give the views: --ranking, with --candidate, or --candidates.")
    if candidate and ranking is None:
        raise typer.BadParameter("--candidate needs a --ranking.")
    listed = read_candidates(candidates)
    with service(context, as_json=as_json) as client:
        views = listed or _of_ranking(client, ranking or "", candidate or [])
        found = find_scene(client, scene).report_visits(vehicle, state, views, expires_in_s=expires)
    _show(found, as_json=as_json)


def visits(context: typer.Context, scene: SceneArgument, as_json: JsonOption = False) -> None:
    """List the reports of vehicles about views, as far as they have not expired."""
    with service(context, as_json=as_json) as client:
        found = find_scene(client, scene).visits()
    _show(found, as_json=as_json)


def _of_ranking(client: Client, ranking_id: str, ids: Sequence[str]) -> list[Candidate]:
    """The candidates of a ranking with these ids; without any the first one that has a rank."""
    ranking = client.rankings.get(ranking_id)
    by_id = {item.id: item for item in ranking.candidates}
    unknown = [name for name in ids if name not in by_id]
    if unknown:
        raise typer.BadParameter(f"{ranking_id} has no candidate {unknown[0]}.")
    chosen = [by_id[name] for name in ids] or [item for item in ranking.candidates if item.rank == 1]
    if not chosen:
        raise typer.BadParameter(f"No candidate of {ranking_id} has a rank. Name one with --candidate.")
    return [Candidate(id=item.id, pose=item.pose) for item in chosen]


def _show(found: Sequence[Visit], *, as_json: bool) -> None:
    if as_json:
        print_json({"visits": [item.model_dump(mode="json") for item in found]})
        return
    print_table(
        ("vehicle", "state", "candidate", "until", "pose"),
        [
            (
                item.vehicle,
                item.state.value,
                item.candidate_id,
                f"{item.expires_at:%T} UTC",
                pose_text(item.pose),
            )
            for item in found
        ],
    )
