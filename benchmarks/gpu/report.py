"""What the steps of the proof wrote: ``python benchmarks/gpu/report.py STEPS OUT STEP``.

Joins the files of the folder STEPS to OUT/proof.json and, to be read, OUT/proof.txt, and says how STEP went.
"""

import json
import sys
from pathlib import Path
from typing import Any

_HIDDEN = ("good", "traceback", "details")


def main() -> None:
    folder, out, last = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]
    files = sorted(folder.glob("*.json"), key=lambda file: file.stat().st_mtime)
    steps = {file.stem: json.loads(file.read_text(encoding="utf-8")) for file in files}
    joined = json.dumps(steps, indent=1, ensure_ascii=False)
    (out / "proof.json").write_text(joined + "\n", encoding="utf-8")
    lines = []
    for name, found in steps.items():
        lines.append(f"{_verdict(found)} {name}")
        lines += [f"        {key}: {_shown(value)}" for key, value in found.items() if key not in _HIDDEN]
    lines += [""] + [
        f"step ms, {count}: " + ", ".join(f"{name} {row['step ms']:.3g}" for name, row in rows.items())
        for count, rows in _steps_by_count(steps).items()
    ]
    (out / "proof.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"{_verdict(steps[last])} {last}, {steps[last].get('took s', 0):.0f} s", flush=True)


def _steps_by_count(steps: dict[str, dict[str, Any]]) -> dict[str, dict[str, dict[str, float]]]:
    """The timed steps of all backends beside each other."""
    counts: dict[str, dict[str, dict[str, float]]] = {}
    for name, found in steps.items():
        for count, row in found.items():
            if isinstance(row, dict) and "step ms" in row:
                counts.setdefault(count, {})[name.removeprefix("steps-")] = row
    return counts


def _verdict(found: dict[str, object]) -> str:
    return "ok " if found.get("good") and not found.get("unfinished") else "BAD"


def _shown(value: object) -> str:
    if isinstance(value, dict):
        verdict = [] if value.get("good", True) else ["BAD"]
        rest = [f"{key} {_shown(one)}" for key, one in value.items() if key not in _HIDDEN]
        return ", ".join(verdict + rest)
    if isinstance(value, list):
        return " ".join(map(str, value)) or "none"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    main()
