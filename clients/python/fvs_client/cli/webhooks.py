"""``fvs-client webhooks``."""

from typing import Annotated, Any

import typer

from fvs_client import EventKind, Webhook
from fvs_client.cli.options import JsonOption, SceneArgument, YesOption
from fvs_client.cli.output import print_json, print_table
from fvs_client.cli.session import confirm, find_scene, service

webhooks = typer.Typer(help="Send the events of scenes to other services.", no_args_is_help=True)

_Id = Annotated[str, typer.Argument(metavar="WEBHOOK", help="A webhook's id.")]


@webhooks.command("create")
def create(
    context: typer.Context,
    scene: SceneArgument,
    url: Annotated[str, typer.Argument(help="Where events are sent; the operator allows its host.")],
    event: Annotated[list[EventKind], typer.Option(help="A kind of event to send; may be repeated.")],
    as_json: JsonOption = False,
) -> None:
    """Create a webhook, and print its id and its secret, which cannot be shown again."""
    with service(context, as_json=as_json) as client:
        webhook = find_scene(client, scene).webhooks.create(url, event)
    if as_json:
        print_json(webhook.model_dump(mode="json"))
        return
    typer.echo(webhook.id)
    typer.echo(webhook.secret)


@webhooks.command("list")
def list_all(context: typer.Context, scene: SceneArgument, as_json: JsonOption = False) -> None:
    """List the webhooks of a scene, and the state of their deliveries."""
    with service(context, as_json=as_json) as client:
        found = find_scene(client, scene).webhooks.list()
    if as_json:
        print_json({"webhooks": [_state(item) for item in found]})
        return
    print_table(
        ("id", "state", "waiting", "failures", "url", "error"),
        [
            (item.id, item.state.value, str(item.pending), str(item.failures), item.url, item.error or "")
            for item in found
        ],
    )


@webhooks.command("enable")
def enable(context: typer.Context, webhook: _Id, as_json: JsonOption = False) -> None:
    """Try the deliveries of a webhook now, also when it is disabled."""
    with service(context, as_json=as_json) as client:
        found = client.webhooks.get(webhook).enable()
    if as_json:
        print_json(_state(found))
    else:
        typer.echo(f"{found.id} is {found.state.value}, {found.pending} events wait")


@webhooks.command("delete")
def delete(context: typer.Context, webhook: _Id, yes: YesOption = False) -> None:
    """Delete a webhook; what it has not delivered is not sent."""
    with service(context, as_json=False) as client:
        found = client.webhooks.get(webhook)
        confirm(f"Delete the webhook {found.id}?", yes=yes)
        found.delete()
    typer.echo(f"{found.id} deleted")


def _state(webhook: Webhook) -> dict[str, Any]:
    """A webhook as JSON, without the secret, which only a new one has."""
    return {name: value for name, value in webhook.model_dump(mode="json").items() if name != "secret"}
