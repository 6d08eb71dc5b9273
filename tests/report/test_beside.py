"""A part of the work in another process: what comes of it, and that it ends."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
import yaml

from heliosweep.processors import processors
from heliosweep.report.page import for_others
from tests.conftest import SMALL
from tests.processes import assert_ends

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or processors() == 1, reason="only Linux copies processes, for a second processor"
)

WORK = """
import multiprocessing, os, threading
from heliosweep.report import beside
from heliosweep.report.beside import Beside

def result(ready, work, what=3):
    with Beside(ready, work) as other:
        other.start()
        other.begin(what)
        found = other.result()
    assert not multiprocessing.active_children()
    return found

assert result(int, lambda what: (2 * what, os.getpid()))[0] == 6
assert result(int, lambda what: os.getpid()) != os.getpid()
for ready, work in ((int, lambda what: 1 / 0), (lambda: 1 / 0, int), (int, lambda what: os._exit(0)),
                    (int, lambda what: lambda: 0), (lambda: os._exit(0), int)):
    assert result(ready, work) is None
with Beside(int, int) as other:
    other.begin(1)
    assert other.result() is None
waits = threading.Event()
thread = threading.Thread(target=waits.wait)
thread.start()
assert result(int, int) is None
waits.set()
thread.join()
assert result(int, int) == 3
daemon = multiprocessing.get_context("fork").Process(target=lambda: result(int, int) and os._exit(2), daemon=True)
daemon.start()
daemon.join()
assert daemon.exitcode == 0
beside.LONGEST = 0.1
assert result(int, lambda what: threading.Event().wait()) is None
beside.processors = lambda: 1
assert result(int, int) is None
"""
KILLED = """
import os, signal
from heliosweep.report.beside import Beside
with Beside(int, int) as other:
    other.start()
    print(other._process.pid, flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
"""


def python(program: str, *arguments: str, **options) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-W", "error", "-c", program, *arguments]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.run(command, env=environment, capture_output=True, text=True, **options)


def test_what_comes_of_the_work():
    done = python(WORK)
    assert (done.returncode, done.stderr) == (0, "")


def test_it_ends_with_a_process_that_is_killed():
    done = python(KILLED)
    assert_ends(int(done.stdout))


def test_figures_of_a_run_are_the_same(tmp_path):
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(SMALL))
    pages = []
    for name, change, said in (
        ("beside", "told = lambda found: print(found is not None) or found", "True"),
        ("failed", "told = lambda found: print(found is not None)", "True"),
        ("alone", "told = lambda found: print(found is not None) or found; beside.processors = lambda: 1", "False"),
    ):
        program = (
            "import heliosweep, sys; from heliosweep.report import beside; result = beside.Beside.result\n"
            f"{change}\nbeside.Beside.result = lambda self: told(result(self))\n"
            "heliosweep.run('study.yaml', sys.argv[1])"
        )
        done = python(program, name, cwd=tmp_path)
        assert (done.returncode, done.stdout.split()) == (0, [said]), done.stderr
        figures = {file.name: file.read_bytes() for file in sorted((tmp_path / name / "figures").iterdir())}
        pages.append((for_others((tmp_path / name / "report.html").read_text(encoding="utf-8")), figures))
    assert pages[0][1]
    assert pages[0] == pages[1] == pages[2]
