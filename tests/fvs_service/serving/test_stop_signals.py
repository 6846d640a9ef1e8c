"""Signals to a process, and the processes below it: real ones, in a process of their own."""

import os
import platform
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from fvs_service.serving.process_tree import command_of, descendants

_GRANDCHILD = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); time.sleep(600)"
_CHILD = f"import subprocess, sys; subprocess.Popen([sys.executable, '-c', {_GRANDCHILD!r}]); print('up')"


@pytest.fixture
def started() -> Iterator[Callable[[str], "subprocess.Popen[str]"]]:
    """Start Python with a program, and return once it has written a line."""
    processes: list[subprocess.Popen[str]] = []

    def start(program: str) -> "subprocess.Popen[str]":
        process = subprocess.Popen(
            [sys.executable, "-c", textwrap.dedent(program)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        processes.append(process)
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        return process

    yield start
    for process in processes:
        process.kill()
        process.wait()
        assert process.stdin is not None
        process.stdin.close()
        assert process.stdout is not None
        process.stdout.close()


def test_a_signal_ends_a_program_that_asks_for_it(started: Callable[[str], "subprocess.Popen[str]"]) -> None:
    process = started("""
        from fvs_service.serving.stop_signals import StopSignals
        with StopSignals(60, lambda: None) as signals:
            print("ready", flush=True)
            assert signals.wait(60) and signals.stopping
    """)
    process.terminate()
    assert process.wait(30) == 0


def test_a_program_that_does_not_ask_ends_at_the_deadline(
    started: Callable[[str], "subprocess.Popen[str]"],
) -> None:
    """The main thread is in a call that returns only after it, so no handler in Python would run."""
    process = started("""
        import ctypes
        from fvs_service.serving.stop_signals import StopSignals
        with StopSignals(1, lambda: print("killed", flush=True)):
            print("ready", flush=True)
            libc = ctypes.CDLL(None)
            while libc.sleep(600):
                pass
    """)
    process.terminate()
    assert process.wait(30) == 128 + signal.SIGTERM
    assert process.stdout is not None
    assert process.stdout.read() == "killed\n"


def test_a_second_signal_ends_a_program_at_once(started: Callable[[str], "subprocess.Popen[str]"]) -> None:
    process = started("""
        import time
        from fvs_service.serving.stop_signals import StopSignals
        with StopSignals(600, lambda: None) as signals:
            print("ready", flush=True)
            assert signals.wait(60)
            print("stopping", flush=True)
            time.sleep(600)
    """)
    process.send_signal(signal.SIGINT)
    assert process.stdout is not None
    assert process.stdout.readline() == "stopping\n"
    process.send_signal(signal.SIGINT)
    assert process.wait(30) == 128 + signal.SIGINT


def test_handlers_are_restored_and_early_signals_are_kept(
    started: Callable[[str], "subprocess.Popen[str]"],
) -> None:
    process = started("""
        import signal, time
        from fvs_service.serving.stop_signals import StopSignals
        before = signal.getsignal(signal.SIGTERM)
        with StopSignals(60, lambda: None) as signals:
            print("ready", flush=True)
            time.sleep(2)
            assert signals.stopping
        assert signal.getsignal(signal.SIGTERM) == before
    """)
    process.terminate()
    assert process.wait(30) == 0


@pytest.mark.skipif(sys.platform != "linux", reason="adopting orphans is the Linux kernel's")
def test_nothing_is_left_below_a_process_whatever_it_ignores(
    started: Callable[[str], "subprocess.Popen[str]"],
) -> None:
    process = started(f"""
        import subprocess, sys
        from fvs_service.serving.process_tree import adopt_orphans, end_descendants, reap_adopted
        adopt_orphans()
        child = subprocess.Popen([sys.executable, "-c", {_CHILD!r}], stdout=subprocess.PIPE)
        child.stdout.readline()
        child.wait()
        reap_adopted([child.pid])
        print("ready", flush=True)
        sys.stdin.readline()
        sys.stdin.readline()
        end_descendants(30)
    """)
    (orphan,) = descendants(process.pid)
    assert process.stdin is not None
    process.stdin.close()
    assert process.wait(60) == 0
    until = time.monotonic() + 30
    while Path(f"/proc/{orphan}").exists():
        assert time.monotonic() < until


@pytest.mark.skipif(
    sys.platform != "linux" or platform.machine() != "x86_64", reason="the number of a system call"
)
def test_the_children_of_a_process_whose_main_thread_has_ended_are_below_it(
    started: Callable[[str], "subprocess.Popen[str]"],
) -> None:
    process = started("""
        import ctypes, subprocess, sys, threading

        def keep():
            child = subprocess.Popen([sys.executable, "-c", "import sys; sys.stdin.read()"])
            print("ready", flush=True)
            child.wait()

        threading.Thread(target=keep).start()
        ctypes.CDLL(None).syscall(60, 0)  # exit, of this thread alone
    """)
    until = time.monotonic() + 30
    while ") Z " not in Path(f"/proc/{process.pid}/stat").read_text():
        assert time.monotonic() < until
    (child,) = (pid for pid in descendants(os.getpid()) if "sys.stdin.read()" in command_of(pid))
    os.kill(child, signal.SIGKILL)
    process.wait(30)


def test_the_end_of_a_child_ends_the_wait(started: Callable[[str], "subprocess.Popen[str]"]) -> None:
    process = started("""
        import subprocess, sys, time
        from fvs_service.serving.stop_signals import StopSignals

        with StopSignals(10, lambda: None) as signals:
            print("ready", flush=True)
            child = subprocess.Popen([sys.executable, "-c", ""])
            began = time.monotonic()
            stopping = signals.wait(600)
            print(stopping, child.wait(), time.monotonic() - began < 300, flush=True)
    """)
    assert process.stdout is not None
    assert process.stdout.readline() == "False 0 True\n"
