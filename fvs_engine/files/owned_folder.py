"""A folder that belongs to one piece of work, identified by a record in it."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Generic

from fvs_engine.errors import EngineError, OutputExistsError
from fvs_engine.files.record import RecordT, read_record, write_record
from fvs_engine.files.storage import storage_errors


@dataclass(frozen=True)
class OwnedFolder(Generic[RecordT]):
    """The folder ``root`` and its identity, a record of type ``kind`` in ``record_name``.

    ``content`` is what such a folder holds, for messages ("reconstruction"). ``remedy`` is the hint for a
    damaged record.
    """

    root: Path
    record_name: str
    kind: type[RecordT]
    content: str
    remedy: str = "Choose another output folder."

    @property
    def path(self) -> Path:
        """The identity's file."""
        return self.root / self.record_name

    def read(self) -> RecordT | None:
        """The identity, None when the folder is new; raises ``StorageError`` when it cannot be used."""
        return read_record(self.path, self.kind, self.remedy)

    def write(self, identity: RecordT) -> None:
        """Replace the identity; atomic."""
        write_record(self.path, identity)

    def create(self, may_precede: Callable[[str], bool] = lambda name: name.startswith(".")) -> None:
        """Create the folder; one without an identity must be empty.

        Entries whose names satisfy ``may_precede`` are ignored: a process that was killed before it wrote the
        identity may have left them. Raises ``OutputExistsError``, ``StorageError``.
        """
        with storage_errors(self.root):
            self.root.mkdir(parents=True, exist_ok=True)
            foreign = sorted(entry.name for entry in self.root.iterdir() if not may_precede(entry.name))
            if foreign and not self.path.exists():
                raise OutputExistsError(
                    f"{self.root} is not empty and holds no {self.content}, but {foreign[0]}.",
                    hint="Choose another output folder; nothing was changed.",
                    path=self.root,
                )

    def require_same(self, differences: list[str], error: type[EngineError] = OutputExistsError) -> None:
        """Raise ``error``, naming the ``differences`` from what the folder holds, if there are any."""
        if differences:
            raise error(
                f"{self.root} holds another {self.content}: {'; '.join(differences)}.",
                hint="Give another output folder, or the settings of the one that is there.",
            )


def differences(old: Mapping[str, object], new: Mapping[str, object]) -> list[str]:
    """One sentence for each value that changed, nested ones by their dotted names."""
    before, now = dict(_flat(old)), dict(_flat(new))
    return [
        f"{name} was {_shown(before.get(name))} and is {_shown(now.get(name))}"
        for name in dict.fromkeys([*now, *before])
        if before.get(name) != now.get(name)
    ]


def _flat(value: Mapping[str, object], prefix: str = "") -> Iterator[tuple[str, object]]:
    for name, part in value.items():
        if isinstance(part, Mapping):
            yield from _flat(part, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", part


def _shown(value: object) -> str:
    return "the default" if value is None else str(value)
