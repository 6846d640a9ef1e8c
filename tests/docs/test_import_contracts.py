"""Every package has its layers: a new module fails `lint-imports`, and a new package fails here."""

import tomllib
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
PACKAGES = ("fvs_engine", "services/fvs_service", "clients/python/fvs_client", "clients/python/fvs_schema")


def test_every_package_is_in_one_exhaustive_contract() -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]
    exhaustive = Counter(
        container
        for contract in contracts["contracts"]
        if contract.get("exhaustive")
        for container in contract["containers"]
    )
    packages = {
        ".".join(folder.relative_to((ROOT / package).parent).parts)
        for package in PACKAGES
        for folder in [ROOT / package, *(found.parent for found in (ROOT / package).rglob("__init__.py"))]
        if sum(module.name != "__init__.py" for module in _modules(folder)) > 1
    }
    assert exhaustive.keys() - packages == set()
    assert {package: exhaustive[package] for package in packages if exhaustive[package] != 1} == {}


def _modules(folder: Path) -> list[Path]:
    """Modules, and packages by their ``__init__``."""
    return [*folder.glob("*.py"), *(found.parent for found in folder.glob("*/__init__.py"))]
