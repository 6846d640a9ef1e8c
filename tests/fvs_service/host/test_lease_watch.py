import subprocess
import sys
from collections.abc import Iterator

import pytest

# The watch of a runner, which reads nothing from standard input at first. Its first byte is the start.
WATCHED = """
import os, threading
from fvs_service.host.runner.lease_watch import LeaseWatch
os.read(0, 1)
watch = LeaseWatch(0.1)
threading.Thread(target=watch.guard, daemon=True).start()
threading.Event().wait(1.2)
print("lives", flush=True)
{then}
threading.Event().wait(30)
"""
READ = "threading.Thread(target=watch.listen, daemon=True).start()"
_ORPHANED = 3


@pytest.fixture
def watched(request: pytest.FixtureRequest) -> Iterator["subprocess.Popen[bytes]"]:
    command = [sys.executable, "-c", WATCHED.format(then=request.param)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0) as process:
        yield process
        process.kill()


@pytest.mark.parametrize("watched", [READ], indirect=True)
def test_an_unread_extension_counts(watched: "subprocess.Popen[bytes]") -> None:
    """Imports hold all threads of a runner for longer than a short lease."""
    assert watched.stdin is not None
    assert watched.stdout is not None
    watched.stdin.write(b"s.")
    assert watched.stdout.readline() == b"lives\n"
    assert watched.wait(20) == _ORPHANED  # once it is read, and no other follows


@pytest.mark.parametrize("watched", [""], indirect=True)
def test_without_an_extension_it_ends(watched: "subprocess.Popen[bytes]") -> None:
    assert watched.stdin is not None
    assert watched.stdout is not None
    watched.stdin.write(b"s")
    assert watched.wait(20) == _ORPHANED
    assert watched.stdout.read() == b""
