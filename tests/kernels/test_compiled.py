"""Compiler options, compiled code on disk and the pure-Python switch."""

import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import numba
import numpy as np
import pytest
from numba.core.registry import cpu_target

from heliosweep.kernels import compiled, helper, machine_code, warm
from heliosweep.kernels.field.efficiency import field_sums, sorted_field
from heliosweep.kernels.field.packets import packet_order
from heliosweep.kernels.field.sweep import sweep
from heliosweep.processors import processors
from tests.processes import assert_ends

SEVERAL_CORES = pytest.mark.skipif(processors() == 1, reason="one core has no other process compile")

COUNT = """
import sys; sys.path.insert(0, {folder!r})
from made.upper import twice_and_one
assert twice_and_one(3.0) == {expected}
print(sum(twice_and_one.stats.cache_misses.values()))
"""
UPPER = """
from heliosweep.kernels.compiled import kernel
from made.lower import twice

@kernel
def twice_and_one(x):
    return twice(x) + 1.0
"""
LOWER = """
from heliosweep.kernels.compiled import inner

@inner
def twice(x):
    return 2.0 * x
"""


def run(program: str, **variables: str) -> str:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), **variables}
    command = [sys.executable, "-W", "error", "-c", program]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.strip()


@pytest.fixture
def made(tmp_path):
    """A package of two modules of kernels, one of which calls the other, and a third that neither imports."""
    folder = tmp_path / "made"
    folder.mkdir()
    (folder / "__init__.py").touch()
    (folder / "upper.py").write_text(UPPER)
    (folder / "lower.py").write_text(LOWER)
    (folder / "other.py").write_text("ONE = 1.0\n")
    return folder


def test_kernels_are_compiled_anew_where_they_or_those_they_call_change(made):
    def compilations(expected: float, *edits: tuple[str, str, str]) -> str:
        for name, old, new in edits:
            path = made / f"{name}.py"
            path.write_text(path.read_text().replace(old, new))
        return run(COUNT.format(folder=str(made.parent), expected=expected), NUMBA_CACHE_DIR=str(made.parent / "cache"))

    words = (
        ("upper", "\n@kernel", "# a comment, on a line of its own\n\n@kernel"),
        ("lower", "def twice(x):", 'def twice(x: float) -> float:\n    """Words."""'),
        ("other", "1.0", "2.0"),
    )
    assert compilations(7.0) == "1"
    assert compilations(7.0, *words) == "0"
    # Python tells two versions of a source file that are of one second by their lengths.
    assert compilations(10.0, ("lower", "2.0 * x", "3.00 * x")) == "1"


def test_old_compiled_code_is_removed(made, monkeypatch):
    monkeypatch.syspath_prepend(str(made.parent))
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(made.parent / "cache"))
    from made.upper import twice_and_one  # type: ignore[import-not-found]

    folder = machine_code.Path(twice_and_one._cache.cache_path)
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(20):
        old = folder / f"upper.twice_and_one-{number:016x}.nbc"
        old.touch()
        os.utime(old, (1e9 + number, 1e9 + number))
    other = folder / "upper.another-0.nbc"
    other.touch()
    assert twice_and_one(3.0) == 7.0
    left = sorted(folder.glob("upper.twice_and_one-*.nbc"))
    assert len(left) == machine_code._KEPT
    assert min(path.stat().st_mtime for path in left) == 1e9 + 20 - (machine_code._KEPT - 1)
    assert other.exists()


def damages(whole: bytes) -> Iterator[bytes]:
    """A file of compiled code that is damaged in 36 ways."""
    yield from (whole[: len(whole) * part // 12] for part in range(12))
    for part in range(12):
        place = (len(whole) - 1) * part // 11
        yield whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :]
    yield from (whole[64:], whole[::-1], whole + b"\0", whole * 2, bytes(len(whole)), b"\x80\x04.", b"text\n")
    yield from (pickle.dumps(value) for value in (None, (), {"a": 1}, b"", "x" * len(whole)))


@pytest.mark.attempts("kernels", 36)
def test_damaged_compiled_code_is_made_again(made, monkeypatch, attempts):
    monkeypatch.syspath_prepend(str(made.parent))
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(made.parent / "cache"))
    for name in [name for name in sys.modules if name.partition(".")[0] == "made"]:
        monkeypatch.delitem(sys.modules, name)
    from made.upper import twice_and_one

    assert twice_and_one(3.0) == 7.0
    (signature,), context, cache = twice_and_one.signatures, cpu_target.target_context, twice_and_one._cache
    file = cache.path(signature, context.codegen())
    whole = file.read_bytes()
    tried = list(damages(whole))
    assert len(tried) == attempts.whole
    for number in attempts.numbers:
        file.write_bytes(tried[number])
        with attempts.at(f"damage {number}"):
            assert cache._load_overload(signature, context) is None
    file.write_bytes(whole)
    assert cache._load_overload(signature, context).entry_point
    file.unlink()
    os.mkfifo(file)
    program = COUNT.format(folder=str(made.parent), expected=7.0)
    environment = {"NUMBA_CACHE_DIR": str(made.parent / "cache")}
    assert run(program, **environment) == "1"
    assert cache._load_overload(signature, context).entry_point
    file.unlink()
    file.mkdir()
    assert run(program, **environment) == "1"
    assert cache._load_overload(signature, context) is None


def test_warm_makes_the_one_signature_ready():
    warm.warm_field()
    for count in (1, 2):  # arrays of one element are of any memory order, arrays of a user may be read-only
        place, sun = np.arange(20.0, 20.0 + 20 * count, 20.0), np.array([[0.0, 0.6, 0.8]])
        place.flags.writeable = sun.flags.writeable = False
        side = np.ones(count)
        field_sums(sorted_field(place, place, place, side, side, 60.0), 0, sun, 0, count)
    assert len(sweep.signatures) == 1
    assert len(packet_order.signatures) == 1
    seconds, fresh = warm.warm_field()
    assert seconds < 0.1
    assert not fresh


def test_code_is_made_of_what_python_calls_alone(tmp_path):
    tried = numba.version_info.short in machine_code._TRIED_WITH
    assert tried, "try kernels/machine_code.py with this version of numba, and add it"
    library = cpu_target.target_context.codegen()._library_class
    program = (
        "import numpy as np; from heliosweep.kernels.field import packets\n"
        "packets.packet_order(np.ones((200, 3)))\n"
        "print(packets._select.signatures, len(packets.packet_order.signatures))\n"
        "import sys; print('numba.np.random.generator_core' in sys.modules)"
    )
    assert run(program, NUMBA_CACHE_DIR=str(tmp_path)).split() == ["[]", "1", "True"]
    # Found in the cache, it needs nothing of what code is made with.
    assert run(program, NUMBA_CACHE_DIR=str(tmp_path)).split() == ["[]", "1", "False"]
    assert cpu_target.target_context.codegen()._library_class is library


def test_without_a_folder_for_compiled_code_kernels_are_compiled_all_the_same(monkeypatch):
    monkeypatch.setattr(compiled, "UNCACHED", [])
    space: dict[str, Any] = {}
    exec("def doubled(x):\n    return 2 * x", space)  # nothing is cached that has no file
    resolve = numba.types.BaseFunction.get_call_type
    assert compiled.kernel(space["doubled"])(3) == 6
    assert compiled.UNCACHED == ["doubled"]
    assert numba.types.BaseFunction.get_call_type is resolve  # the compiler is again what others know


def test_each_family_warms_its_own_kernels():
    program = (
        "import sys; from heliosweep.kernels.warm import warm_dish; warm_dish()\n"
        "print('heliosweep.kernels.dish' in sys.modules, 'heliosweep.kernels.field.efficiency' in sys.modules)"
    )
    assert run(program).split() == ["True", "False"]


HELPED = """
from heliosweep.kernels.compiled import apart, kernel

@apart
def tenfold(x):
    return 10.0 * x

@kernel
def tenfold_and_one(x):
    return tenfold(x) + 1.0

def part():
    from heliosweep.kernels.machine_code import compile_part
    from numba import float64
    assert compile_part(tenfold, float64) == float64
"""
WITH_HELP = """
import os, sys; from pathlib import Path
os.chdir({folder!r}); sys.path[:0] = ["", Path({folder!r})]
from made.helped import tenfold, tenfold_and_one
from heliosweep.kernels.helper import beside
with beside({task!r}):
    assert tenfold_and_one(3.0) == 31.0
print(sum(tenfold.part.stats.cache_hits.values()))
"""


@SEVERAL_CORES
def test_another_process_compiles_a_part(made):
    (made / "helped.py").write_text(HELPED)
    for number, (task, hits) in enumerate(
        (("from made.helped import part; part()", "1"), ("raise SystemExit(1)", "0"), ("import made.nothing", "0"))
    ):
        program = WITH_HELP.format(folder=str(made.parent), task=task)
        assert run(program, NUMBA_CACHE_DIR=str(made.parent / f"cache{number}")) == hits


@SEVERAL_CORES
def test_the_helper_ends_with_a_process_that_is_killed():
    program = (
        "import os, signal; from heliosweep.kernels import helper\n"
        "with helper.beside('import time; time.sleep(60)'):\n"
        "    helper.start(); print(helper._Helper.process.pid, flush=True); os.kill(os.getpid(), signal.SIGKILL)"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    killed = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True)
    assert killed.returncode == -signal.SIGKILL
    assert_ends(int(killed.stdout))


def test_one_processor_is_left_to_one_process(monkeypatch):
    monkeypatch.setattr(helper, "processors", lambda: 1)
    with helper.beside("raise SystemExit"):
        helper.start()
        assert helper._Helper.process is None


def test_a_kernel_that_cannot_be_made_says_why(monkeypatch):
    def fail(*_: object) -> None:
        raise AttributeError("of the compiler")

    monkeypatch.setattr(compiled, "_compiled", fail)
    for use in (lambda each: each.stats, lambda each: each._numba_type_, lambda each: each(1.0)):
        with pytest.raises(AttributeError, match="of the compiler"):
            use(compiled._Kernel(len, {}))


@SEVERAL_CORES
def test_the_helper_compiles_what_fields_call(tmp_path):
    program = (
        "from heliosweep.kernels.warm import warm_field; print(warm_field()[1])\n"
        "from heliosweep.kernels.field.neighbours import by_cells\n"
        "from heliosweep.kernels.field.packets import packet_order\n"
        "from heliosweep.kernels.field.unions import unions\n"
        "for each in (unions.part, packet_order, by_cells): print(sum(each.stats.cache_hits.values()))"
    )
    assert run(program, NUMBA_CACHE_DIR=str(tmp_path)).split() == ["True", "1", "1", "1"]


def test_options():
    for dispatcher in (sweep, packet_order):
        options = dispatcher.targetoptions
        assert options["nogil"]
        assert options["error_model"] == "numpy"
        assert not options.get("parallel")
        assert not options.get("fastmath")


PLAIN = """
import sys
import numpy as np
from heliosweep.grid.sun import sun_vectors
from heliosweep.kernels.dish import pack_windows, window_errors
from heliosweep.kernels.field.efficiency import field_series, sorted_field
x, y, side = np.array([10., 19., 30.]), np.array([20., 21., 60.]), np.full(3, 5.)
s = np.array([[.8, .3, .2]]) / np.sqrt(.77)
print(field_series(sorted_field(x, y, side, side, side, 50.), 0, s, 0, 3).ravel().tolist())
utc = np.datetime64('2021-06-21T01:00', 'ns') + np.arange(9) * np.timedelta64(1, 'h')
windows = pack_windows(sun_vectors(utc, 40.0, 95.0), [0, 4, 9])
for model in (0, 1):
    errors = window_errors(model, windows, [0.002, 0.7], [[0.3], [2.0]], [[[0.0]], [[1e-3]]], 0.0, 1e-3)
    print([repr(value) for value in np.ravel(errors)])
print('numba' in sys.modules)
"""


def test_kernels_run_as_plain_python_with_the_same_result():
    compiled_found, plain_found = (run(PLAIN, HELIOSWEEP_PURE_PYTHON=switch).splitlines() for switch in ("0", "1"))
    assert (compiled_found.pop(), plain_found.pop()) == ("True", "False")
    assert compiled_found == plain_found
