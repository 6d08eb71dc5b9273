"""Compiler options, the warm start and the pure-Python switch."""

import operator
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.core import types
from numba.core.registry import cpu_target

from heliosweep.kernels import compiled, parts, warm
from heliosweep.kernels.field import field_sums, sweep
from heliosweep.kernels.packets import packet_order


def test_warm_makes_the_one_signature_ready():
    warm.warm_field()
    for count in (1, 2):  # arrays of one element are of any memory order, arrays of a user may be read-only
        place, sun = np.arange(20.0, 20.0 + 20 * count, 20.0), np.array([[0.0, 0.6, 0.8]])
        place.flags.writeable = sun.flags.writeable = False
        side = np.ones(count)
        field_sums(place, place, place, side, side, 60.0, 0, sun, 0, count)
    assert len(sweep.signatures) == 1
    assert len(packet_order.signatures) == 1
    seconds, fresh = warm.warm_field()
    assert seconds < 0.1
    assert not fresh


def test_code_is_made_of_what_python_calls_alone(tmp_path):
    assert numba.version_info.short in parts._TRIED_WITH, "try kernels/parts.py with this version of numba, and add it"
    program = (
        "import numpy as np; from heliosweep.kernels import packets\n"
        "packets.packet_order(np.ones((200, 3)))\n"
        "print(packets._select.signatures, len(packets.packet_order.signatures))"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, env=environment)
    assert done.stdout.split() == ["[]", "1"]


def test_kernels_go_through_few_passes_and_leave_the_compiler_as_it_was():
    before = types.BaseFunction.get_call_type
    space: dict[str, Any] = {}
    exec("def largest(x, y):\n    return max(x, y) + max(x + y, y)", space)
    largest = compiled.kernel(space["largest"])
    assert largest(1.0, 2) == 5.0
    (result,) = largest.overloads.values()
    (passes,) = result.metadata["pipeline_times"].values()
    assert len(passes) < 12
    assert types.BaseFunction.get_call_type is before


def test_signatures_of_operators_are_found_once_and_those_of_compiled_code_each_time():
    typing, asked = cpu_target.typing_context, []

    def find(function, *call):
        asked.append(function)
        return types.BaseFunction.get_call_type(function, *call)

    typing.refresh()
    get_call_type = parts._remembered(find)
    add, largest = (typing.resolve_value_type(each) for each in (operator.add, max))
    for function in (add, largest, add, largest):
        kind = types.float64 if function is add else types.int64
        get_call_type(function, typing, (types.float64, kind), {})
    assert asked == [add, largest, largest]
    assert get_call_type(add, typing, (types.float64, types.float64), {}).return_type == types.float64
    assert get_call_type(add, typing, (types.int64, types.int64), {}).return_type == types.int64
    assert asked == [add, largest, largest, add]


def test_without_a_folder_for_compiled_code_kernels_are_compiled_all_the_same(monkeypatch):
    monkeypatch.setattr(compiled, "UNCACHED", [])
    space: dict[str, Any] = {}
    exec("def doubled(x):\n    return 2 * x", space)  # numba caches nothing that has no file
    assert compiled.kernel(space["doubled"])(3) == 6
    assert compiled.UNCACHED == ["doubled"]


def test_each_family_warms_its_own_kernels():
    program = (
        "import sys; from heliosweep.kernels.warm import warm_dish; warm_dish()\n"
        "print('heliosweep.kernels.tracking' in sys.modules, 'heliosweep.kernels.field' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True", "False"]


def test_options():
    for dispatcher in (sweep, packet_order):
        options = dispatcher.targetoptions
        assert options["nogil"]
        assert options["error_model"] == "numpy"
        assert not options.get("parallel")
        assert not options.get("fastmath")


def test_kernels_run_as_plain_python_with_nearly_the_same_result():
    program = (
        "import numpy as np, sys\n"
        "from heliosweep.kernels.field import field_series\n"
        "x, y, side = np.array([10., 19., 30.]), np.array([20., 21., 60.]), np.full(3, 5.)\n"
        "s = np.array([[.8, .3, .2]]) / np.sqrt(.77)\n"
        "print(field_series(x, y, side, side, side, 50., 0, s, 0, 3).ravel().tolist(), 'numba' in sys.modules)"
    )
    results = []
    for switch in ("0", "1"):
        run = subprocess.run(
            [sys.executable, "-W", "error", "-c", program],
            env={**os.environ, "HELIOSWEEP_PURE_PYTHON": switch, "PYTHONPATH": os.pathsep.join(sys.path)},
            capture_output=True,
            text=True,
            check=True,
        )
        results.append(run.stdout.replace("True", "").replace("False", "").strip())
    assert results[0] == results[1]


def test_code_of_old_sources_is_removed(tmp_path):
    def entry(version: str, age: float) -> Path:
        path = tmp_path / f"field.sweep-{version}-0a1b2c-7.py311.nbi"
        path.touch()
        os.utime(path, (1e9 - age, 1e9 - age))
        return path

    now, other = entry(compiled._FINGERPRINT, 99.0), tmp_path / "field.cpython-311.pyc"
    other.touch()
    versions = [entry(f"{number:012x}", number) for number in range(8)]
    compiled._remove_stale(str(tmp_path))
    assert {now, other, *versions[: compiled._KEPT - 1]} == set(tmp_path.iterdir())
