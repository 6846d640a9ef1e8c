"""Arguments and options that several commands share."""

from typing import Annotated

import typer

SceneArgument = Annotated[str, typer.Argument(metavar="SCENE", help="A scene's id or name.")]
SnapshotArgument = Annotated[str, typer.Argument(metavar="SNAPSHOT", help="A snapshot's id.")]
JobArgument = Annotated[str, typer.Argument(metavar="JOB", help="A job's id.")]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print the result as JSON; progress and errors as JSON on stderr.")
]
YesOption = Annotated[bool, typer.Option("--yes", "-y", help="Delete without asking.")]
WaitOption = Annotated[bool, typer.Option("--wait/--no-wait", help="Wait until the job has ended.")]
TimeoutOption = Annotated[
    float | None,
    typer.Option("--timeout", min=0, metavar="S", help="Wait at most S seconds.", show_default="no limit"),
]
IterationsOption = Annotated[
    int | None,
    typer.Option("--iterations", min=1, help="Training iterations.", show_default="by number of images"),
]
LongSideOption = Annotated[
    int | None,
    typer.Option("--long-side", min=64, metavar="PX", help="Reduce training images to this long side."),
]
TestEveryOption = Annotated[
    int | None,
    typer.Option(
        "--test-every",
        min=2,
        metavar="N",
        help="Hold out every Nth image, and measure the model on it.",
        show_default="none held out",
    ),
]
