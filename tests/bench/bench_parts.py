"""What the client does for each part, `python -m tests.bench parts`: a family whose numbers cost nothing.

Timed are processes of their own: the plan; a run that is killed (SIGKILL) when a third of the parts is done; and the
run that goes on to the result. The parts are computed one by one in the client itself, so that the time of a part is
the most that a client spends on a part of any cluster. BENCH_PARTS says how many there are, a million by default.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import psutil

from tests.bench.table import Line

PARTS = int(os.environ.get("BENCH_PARTS", "1000000"))


def family() -> Any:
    """A family with one swept key, of which each value is a part."""
    import xarray as xr
    from pydantic import Field

    from heliosweep.config.block import Block
    from heliosweep.config.study import Study
    from heliosweep.config.sweep import Sweep
    from heliosweep.config.values import Quantity
    from heliosweep.families.family import Family
    from heliosweep.grid.parameters import Parameters
    from heliosweep.grid.plan import Workload
    from heliosweep.grid.regions import Variable

    class Given(Block):
        number: Annotated[float | Sweep, Quantity("A number", "1")]

    class NothingStudy(Study):
        family: Literal["nothing"]
        given: Annotated[Given, Field(description="What is given")]

    class Nothing(Family):
        name, title = "nothing", "Twice a number"

        def study_class(self) -> type[Study]:
            return NothingStudy

        def workload(self, study: Any) -> Workload:
            return Workload(Parameters(study).sizes, {}, 1, "numbers", 1e-9, lambda points, length: 8 * points)

        def variables(self, study: Any) -> dict[str, Variable]:
            return {"double": Variable(("number",), {"units": "1", "long_name": "twice the number"})}

        def coordinates(self, study: Any) -> xr.Dataset:
            return xr.Dataset(coords=Parameters(study).coordinates())

        def prepare(self, study: Any) -> tuple[float, bool]:
            return 0.0, False

        def inputs(self, study: Any) -> None:
            return None

        def compute(self, study: Any, inputs: Any, region: Any) -> xr.Dataset:
            span = region["number"]
            return xr.Dataset({"double": ("number", 2.0 * np.arange(span.start, span.stop))})

        def remarks(self, result: xr.Dataset) -> tuple[str, ...]:
            return ()

    return Nothing()


def run(what: str, folder: Path) -> None:
    """Plan the study, or run it in a folder, in this process."""
    from heliosweep import api, open_result
    from heliosweep.config.load import load_mapping
    from heliosweep.families import family as families

    one = family()
    known = {"nothing": one}
    families.families = api.families = lambda: known  # type: ignore[assignment]
    study = load_mapping(
        {
            "family": "nothing",
            "given": {"number": {"start": 0, "stop": PARTS - 1, "step": 1}},
            "execution": {"scheduler": "synchronous", "chunks": {"number": 1}},
        },
        {"nothing": one.study_class()},
    )
    if what == "plan":
        assert api.plan(study, folder).part_count == PARTS
    else:
        api.run(study, folder, report=False)
        with open_result(folder) as result:
            assert float(result["double"][-1]) == 2.0 * (PARTS - 1)


def timed(what: str, folder: Path, kill_after: int = 0) -> tuple[float, float]:
    """Seconds and largest memory [MB] of a process; killed when so many parts are stored."""
    start, most = time.perf_counter(), 0
    process = subprocess.Popen([sys.executable, "-m", "tests.bench.bench_parts", what, str(folder)])
    journal = folder / "working" / "journal.jsonl"
    lines, size = 0, 0
    while process.poll() is None:
        time.sleep(0.2)
        try:
            most = max(most, psutil.Process(process.pid).memory_info().rss)
        except psutil.NoSuchProcess:
            break
        if kill_after and journal.exists():
            with journal.open("rb") as file:
                file.seek(size)
                content = file.read()
            lines, size = lines + content.count(b"\n"), size + len(content)
            if lines >= kill_after:
                process.send_signal(signal.SIGKILL)
    code = process.wait()
    assert code == (-signal.SIGKILL if kill_after else 0), code
    return time.perf_counter() - start, most / 1e6


def lines() -> Iterator[Line]:
    """What ran, and how long it took."""
    with tempfile.TemporaryDirectory() as name:
        folder, third = Path(name) / "out", PARTS // 3
        for words, what, parts, kill in (
            ("planned", "plan", PARTS, 0),
            ("run until it is killed", "run", third, third),
            ("run again, to the result", "run", PARTS - third, 0),
        ):
            seconds, most = timed(what, folder, kill)
            beside = f"{1e3 * seconds / parts:.3f} ms a part"
            yield Line(f"{PARTS:,} parts that cost nothing: {words}", f"{seconds:.1f} s, {most:.0f} MB", beside)


if __name__ == "__main__":
    run(sys.argv[1], Path(sys.argv[2]))
