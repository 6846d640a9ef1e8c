"""A file for TLS that cannot be used is named before the service starts."""

import subprocess
from pathlib import Path

import certificates
import pytest
from fvs_service.gateway.certificates import require_certificates
from fvs_service.settings import Settings
from typer.testing import CliRunner

from fvs_engine.cli.app import app
from fvs_engine.errors import InvalidInputError


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Certificates and keys; one file with both, one with an encrypted key, one with nothing."""
    folder = tmp_path_factory.mktemp("certificates")
    known = certificates.made_for_tests(folder)
    service, key = known["service"], known["service"].with_suffix(".key")
    files = {"certificate": service, "key": key, "other key": known["client"].with_suffix(".key")}
    files |= {name: folder / f"{name}.pem" for name in ("both", "encrypted", "junk")}
    files["both"].write_text(key.read_text() + service.read_text())
    files["junk"].write_text("junk")
    subprocess.run(
        ["openssl", "rsa", "-aes256", "-passout", "pass:x", "-in", key, "-out", files["encrypted"]],
        check=True,
        capture_output=True,
    )
    return files


def _settings(files: dict[str, Path], names: tuple[str, str, str | None]) -> Settings:
    certificate, key, authority = names
    return Settings(
        tls_certificate=files[certificate],
        tls_key=files[key],
        tls_client_ca=authority and files[authority],
    )


@pytest.mark.parametrize(
    "names", [("certificate", "key", None), ("both", "both", None), ("certificate", "key", "certificate")]
)
def test_files_that_belong_together_are_accepted(
    files: dict[str, Path], names: tuple[str, str, str | None]
) -> None:
    require_certificates(_settings(files, names))


@pytest.mark.system
@pytest.mark.parametrize(
    ("names", "variable", "file"),
    [
        (("junk", "key", None), "FVS_TLS_CERTIFICATE", "junk"),
        (("key", "key", None), "FVS_TLS_CERTIFICATE", "key"),
        (("certificate", "junk", None), "FVS_TLS_KEY", "junk"),
        (("certificate", "other key", None), "FVS_TLS_KEY", "other key"),
        (("certificate", "encrypted", None), "FVS_TLS_KEY", "encrypted"),
        (("certificate", "key", "junk"), "FVS_TLS_CLIENT_CA", "junk"),
        (("certificate", "key", "key"), "FVS_TLS_CLIENT_CA", "key"),
    ],
)
def test_the_file_that_cannot_be_used_is_named(
    files: dict[str, Path], names: tuple[str, str, str | None], variable: str, file: str
) -> None:
    with pytest.raises(InvalidInputError) as error:
        require_certificates(_settings(files, names))
    assert error.value.message.startswith(f"{variable}: {files[file]} cannot be used")


def test_the_service_does_not_start_with_a_wrong_file(
    files: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FVS_TLS_CERTIFICATE", str(files["junk"]))
    monkeypatch.setenv("FVS_TLS_KEY", str(files["key"]))
    refused = CliRunner().invoke(app, ["serve", "--root", str(tmp_path / "service"), "--port", "0"])
    assert refused.exit_code == 2
    assert "FVS_TLS_CERTIFICATE" in refused.stderr
    assert "port" not in refused.stderr
