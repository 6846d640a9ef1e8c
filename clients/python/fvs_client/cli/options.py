"""Arguments and options that several commands share."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, TypeVar, get_args

import typer

NumbersT = TypeVar("NumbersT", bound=tuple[float, ...] | None)

SceneArgument = Annotated[str, typer.Argument(metavar="SCENE", help="A scene's id or name.")]
SnapshotArgument = Annotated[str, typer.Argument(metavar="SNAPSHOT", help="A snapshot's id.")]
JobArgument = Annotated[str, typer.Argument(metavar="JOB", help="A job's id.")]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print the result as JSON; progress and errors as JSON on stderr.")
]


def _methods() -> tuple[str, ...]:
    from fvs_schema.words import Method as RankingMethod

    return get_args(RankingMethod)


MethodOption = Annotated[
    str,
    typer.Option(
        "--method", autocompletion=_methods, help="Method of ranking; `fvs-client status` lists all."
    ),
]
CandidatesOption = Annotated[
    Path | None,
    typer.Option(
        "--candidates",
        exists=True,
        dir_okay=False,
        metavar="FILE",
        help='JSON: [{"id": …, "pose": {…}}, …].',
    ),
]
SnapshotOption = Annotated[
    str | None,
    typer.Option("--snapshot", metavar="ID", help="Snapshot with the model.", show_default="the latest"),
]
ForVehicleOption = Annotated[
    str | None,
    typer.Option(
        "--for-vehicle",
        metavar="NAME",
        help="Name of the requesting vehicle; the views that it flies to itself stay candidates.",
    ),
]
VolumeOption = Annotated[
    Path | None,
    typer.Option(
        "--volume",
        exists=True,
        dir_okay=False,
        metavar="FILE",
        help="JSON: generate candidates in a volume: box, cylinder, prism, shell, corridor.",
    ),
]
AimOption = Annotated[
    str | None,
    typer.Option(
        "--aim",
        metavar="WHERE",
        help="What candidates in a volume look at: the middle of the model, its nearest part, or a point: "
        "middle, nearest or X,Y,Z.",
        show_default="middle",
    ),
]
LevelOption = Annotated[
    bool, typer.Option("--level", help="Keep the camera of candidates in a volume level.")
]
NoFlyOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--no-fly",
        exists=True,
        dir_okay=False,
        metavar="FILE",
        help="JSON: a volume to stay out of; may be repeated.",
        show_default=False,
    ),
]
YesOption = Annotated[bool, typer.Option("--yes", "-y", help="Delete without asking.")]
WaitOption = Annotated[bool, typer.Option("--wait/--no-wait", help="Wait until the job has ended.")]
TimeoutOption = Annotated[
    float | None,
    typer.Option(
        "--timeout",
        min=0,
        max=31_536_000,
        metavar="S",
        help="Wait at most S seconds.",
        show_default="no limit",
    ),
]
AnswerTimeoutOption = Annotated[
    float | None,
    typer.Option(
        "--timeout", min=0, max=31_536_000, metavar="S", help="Wait at most S seconds.", show_default="180"
    ),
]
IterationsOption = Annotated[
    int | None,
    typer.Option(
        "--iterations",
        min=1,
        max=100_000,
        help="Training iterations; only a scene's first update and fine jobs can set this.",
        show_default="the service's",
    ),
]
LongSideOption = Annotated[
    int | None,
    typer.Option(
        "--long-side",
        min=64,
        max=8192,
        metavar="PX",
        help="Long side of the training images; only a scene's first update and fine jobs can set this.",
        show_default="the service's",
    ),
]
TestEveryOption = Annotated[
    int | None,
    typer.Option(
        "--test-every",
        min=2,
        max=1_000,
        metavar="N",
        help="Hold out every Nth image, and measure the model on it.",
        show_default="none held out",
    ),
]


def within(*ranges: tuple[float, float]) -> Callable[[NumbersT], NumbersT]:
    """The callback of an option with several numbers, which have a range each."""

    def checked(numbers: NumbersT) -> NumbersT:
        given: tuple[float, ...] = () if numbers is None else numbers
        for number, (lowest, highest) in zip(given, ranges, strict=False):
            if not lowest <= number <= highest:
                text = str(number)[:40]
                raise typer.BadParameter(f"{text} is not between {lowest:g} and {highest:g}.")
        return numbers

    return checked
