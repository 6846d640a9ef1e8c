import platform
import subprocess
import sys

import pytest

pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="arenas are glibc's"),
]

_ARENAS_OF_THREADS = """
import ctypes, sys, threading
from fvs_service.serving.process import limit_arenas

if "limited" in sys.argv:
    limit_arenas()
libc = ctypes.CDLL(None)
all_run = threading.Barrier(8)

def allocate():
    libc.malloc(1000)
    all_run.wait()  # an arena is given to the next thread when its own has ended

threads = [threading.Thread(target=allocate) for _ in range(8)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
libc.fopen.restype = ctypes.c_void_p
file = ctypes.c_void_p(libc.fopen(b"/dev/stdout", b"w"))
libc.malloc_info(0, file)
libc.fflush(file)
"""


def _arenas(*arguments: str) -> int:
    run = [sys.executable, "-c", _ARENAS_OF_THREADS, *arguments]
    return subprocess.run(run, capture_output=True, text=True, check=True).stdout.count("<heap nr=")


@pytest.mark.system
def test_threads_share_two_arenas() -> None:
    assert _arenas() > 4
    assert _arenas("limited") == 2
