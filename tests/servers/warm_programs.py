"""Programs that start without importing anything: forks of one process that has imported all of it.

Each start of ``fvs`` or of a client in Python takes up to four seconds of processor time, in which it imports
libraries. ``warm_programs`` makes ``fvs``, ``fvs-client`` and ``python -W error FILE`` for shell scripts.
"""

import atexit
import contextlib
import gc
import importlib
import json
import os
import runpy
import signal
import socket
import subprocess
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NoReturn

_IMPORTED = (
    "fvs_client.cli.app",
    "fvs_engine.cli.app",
    "fvs_engine.cli.report",
    "fvs_engine.lab.evaluate.from_datasets",
    "fvs_engine.pipeline.select",
    "fvs_engine.lab.simulate",
    "fvs_service.application",
    "fvs_service.cli.serve",
    "matplotlib.figure",
    "pymap3d",
)
_SHIM = """#!{python} -IS
import json, os, socket, sys
with socket.socket(socket.AF_UNIX) as server:
    server.connect({address!r})
    order = json.dumps([{name!r}, sys.argv[1:], os.getcwd(), dict(os.environ)]).encode()
    socket.send_fds(server, [len(order).to_bytes(4, "big")], [0, 1, 2])
    server.sendall(order)
    status = server.recv(1)
sys.exit(status[0] if status else "The process that runs {name} has ended.")
"""
"""What a shell script starts; it takes a hundredth of a second."""


@contextlib.contextmanager
def warm_programs() -> Iterator[Path]:
    """A folder with the programs, for PATH."""
    with tempfile.TemporaryDirectory(prefix="fvs-programs-") as name:  # the path of a socket is short
        folder, address = Path(name) / "bin", str(Path(name) / "socket")
        folder.mkdir()
        for program in ("fvs", "fvs-client", "python"):
            text = _SHIM.format(python=sys.executable, address=address, name=program)
            (folder / program).write_text(text, encoding="utf-8")
            (folder / program).chmod(0o755)
        # A process with threads cannot be forked: those of OpenMP among them.
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        pipe = subprocess.PIPE
        with subprocess.Popen(
            [sys.executable, __file__, address], env=environment, stdin=pipe, stdout=pipe
        ) as server:
            assert server.stdout is not None
            try:
                assert server.stdout.readline() == b"ready\n"
                yield folder
            finally:
                server.kill()


def _serve(address: str) -> Callable[[], Any]:
    """Fork for every order; returns in the forks, with the program to run."""
    for module in _IMPORTED:
        importlib.import_module(module)
    gc.freeze()  # a fork that looks for garbage copies the memory in which it looks
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(address)
        listening.listen()
        print("ready", flush=True)  # noqa: T201
        signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for those that wait
        while True:
            connection, _ = listening.accept()
            if os.fork() == 0:
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                break
            connection.close()
    head, (stdin, stdout, stderr), _, _ = socket.recv_fds(connection, 4, 3)
    with connection.makefile("rb") as reader:
        name, arguments, folder, environment = json.loads(reader.read(int.from_bytes(head, "big")))
    child = os.fork()
    if child:
        _, status = os.waitpid(child, 0)
        code = os.waitstatus_to_exitcode(status)
        connection.sendall(bytes([code if code >= 0 else 128 - code]))
        os._exit(0)
    connection.close()
    for standard, own in enumerate((stdin, stdout, stderr)):
        os.dup2(own, standard)
        os.close(own)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    return _program(name, arguments)


def _program(name: str, arguments: list[str]) -> Callable[[], Any]:
    if name == "python":
        flag, action, script = arguments
        assert (flag, action) == ("-W", "error")
        sys.argv, sys.path[0] = [script], str(Path.cwd())
        warnings.resetwarnings()
        warnings.simplefilter("error")
        return lambda: runpy.run_path(script, run_name="__main__")
    sys.argv = [name, *arguments]
    package = {"fvs": "fvs_engine.cli", "fvs-client": "fvs_client.cli"}[name]
    main: Callable[[], Any] = importlib.import_module(package).main
    return main


def _run(program: Callable[[], Any]) -> NoReturn:
    """Run a program without the interpreter's own end, which visits every object and takes two seconds."""
    status: Any = 1
    try:
        program()
        status = 0
    except SystemExit as ended:
        status = ended.code or 0
    except BaseException:
        traceback.print_exc()
    if not isinstance(status, int):
        sys.stderr.write(f"{status}\n")
        status = 1
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


if __name__ == "__main__":
    _run(_serve(sys.argv[1]))
