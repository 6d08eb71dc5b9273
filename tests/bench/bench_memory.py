"""Peak memory of whole runs beside what the plan said: `python -m tests.bench memory`.

Shipped studies, and larger ones for each part of the estimate.

Each run is a process of its own. Its memory is what the system says it held at most, until its manifest was there and
until its end, after the report; with worker processes, the sum over all processes, looked at every 20 ms. Names of
studies as arguments of this module measure these alone.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tests.bench.table import Line

ROOT = Path(__file__).parent.parent.parent
STUDIES = ROOT / "studies"
#: How far the plan may be from what is measured.
FACTOR = 1.5
#: The system is looked at so often. [s]
INTERVAL = 0.02


def peak_memory(study: Path, output: Path, *arguments: str) -> tuple[int, int]:
    """Run a study in a process of its own; the most memory that it and its children held, until and with the report.

    [bytes]
    """
    command = [sys.executable, "-m", "heliosweep", "run", str(study), "--output", str(output), *arguments]
    with tempfile.TemporaryFile() as errors:
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=errors)
        alone = together = before = 0
        while process.poll() is None:
            if not (output / "manifest.json").exists():
                before = max(alone, together)
            # Not that of the usage at its end: that one begins with the memory of the process that started it.
            alone = _held(process.pid, "status", "VmHWM") or alone
            children = list(_below(process.pid))
            if children:
                together = max(
                    together, sum(_held(number, "smaps_rollup", "Pss") for number in (process.pid, *children))
                )
            time.sleep(INTERVAL)
        if process.returncode:
            errors.seek(0)
            raise RuntimeError(f"{study.name}: {errors.read().decode()[-2000:]}")
    return before, max(alone, together)


def _below(number: int) -> Iterator[int]:
    """All processes below one."""
    with suppress(OSError):  # it has ended
        for task in Path(f"/proc/{number}/task").iterdir():
            for child in (task / "children").read_text().split():
                yield int(child)
                yield from _below(int(child))


def _held(number: int, file: str, name: str) -> int:
    """Memory of a process as the system counts it; shared pages by their share in ``Pss``. [bytes]."""
    with suppress(OSError):
        for line in Path(f"/proc/{number}/{file}").read_text().splitlines():
            if line.startswith(f"{name}:"):
                return int(line.split()[1]) * 1024
    return 0


def shipped(name: str, **blocks: Any) -> dict[str, Any]:
    """A shipped study with other blocks, compared with nothing that was published."""
    content: dict[str, Any] = yaml.safe_load((STUDIES / f"{name}.yaml").read_text(encoding="utf-8"))
    content.pop("report", None)
    return content | blocks


def stagger(heliostats: int) -> dict[str, Any]:
    return {"radial_stagger": {"clearance": 16, "inner_radius": 61.3, "heliostats": heliostats}}


def _field(heliostats: int, days: int, hours: int, **blocks: Any) -> dict[str, Any]:
    time_block = {
        "clock": "solar",
        "days": {"start": 1, "stop": days, "step": 1},
        "hours": {"start": 6, "stop": 18, "step": 12 / hours},
        "sampling": "midpoint",
    }
    one = {"tracking": "azimuth_elevation", "site": {"latitude": 30}, "layout": stagger(heliostats)}
    return shipped("latitude_sweep", **one, time=time_block) | blocks


def _changed(content: dict[str, Any], block: str, **keys: Any) -> dict[str, Any]:
    return content | {block: content.get(block, {}) | keys}


def larger_studies() -> dict[str, dict[str, Any]]:
    """Studies whose memory is that of one part of the estimate."""
    series = {"output": {"time_series": True}}
    return {
        "series_300_MB": _field(1000, 365, 26, **series),
        "series_2_processes": _field(1000, 365, 26, **series, execution={"workers": 2, "scheduler": "processes"}),
        "field_100k_heliostats": _field(100_000, 2, 2),
        "drift_3000_sizes": _changed(
            shipped("spot_drift"), "error", size={"start": -12, "stop": 12, "step": 24 / 2999}
        ),
        "draws_1000_heliostats": shipped("mount_error_monte_carlo", layout=stagger(1000)),
        "gazing_fine_pixels": _changed(shipped("defieux2020_figures"), "heliostat", pixel=0.02),
    }


def written(name: str, content: dict[str, Any] | None, folder: Path) -> Path:
    """File of a shipped study, or of another one beside what the shipped ones take."""
    if content is None:
        return STUDIES / f"{name}.yaml"
    for place in STUDIES.iterdir():
        if place.is_dir() and not (folder / place.name).exists():
            (folder / place.name).symlink_to(place)
    study = folder / f"{name}.yaml"
    study.write_text(yaml.safe_dump(content), encoding="utf-8")
    return study


def measured(name: str, content: dict[str, Any] | None, folder: Path) -> Iterator[tuple[bool, int, int]]:
    """Whether with a report, what the plan says and what is measured [bytes]."""
    output = folder / f"{name}-result"
    peaks = peak_memory(written(name, content, folder), output)
    manifest = json.loads((output / "manifest.json").read_text(encoding="utf-8"))
    shutil.rmtree(output)
    for report, peak in enumerate(peaks):
        yield bool(report), manifest["plan"]["peak_memory"], peak


def lines(names: Sequence[str] = ()) -> Iterator[Line]:
    """All runs together, and each of which the plan was far off; all of them one by one on standard error."""
    larger, ratios = larger_studies(), {True: list[float](), False: list[float]()}
    wanted = names or [*(path.stem for path in sorted(STUDIES.glob("*.yaml"))), *larger]
    with tempfile.TemporaryDirectory() as folder:
        for name in wanted:
            for report, plan, peak in measured(name, larger.get(name), Path(folder)):
                ratio = plan / peak
                ratios[report].append(ratio)
                ran = f"run, {name}{'' if report else ', before its report'}: peak memory"
                line = Line(ran, f"{peak / 1e6:.0f} MB", f"plan: {plan / 1e6:.0f} MB, {ratio:.2f} times it")
                print(f"  {line.ran:60} {line.measured:>10}  {line.beside}", file=sys.stderr, flush=True)
                if not 1 / FACTOR <= ratio <= (FACTOR if report else np.inf):  # the plan counts the report
                    yield line
    for report, found in ratios.items():
        low, middle, high = np.quantile(found, [0.0, 0.5, 1.0])
        told = f"plan: {middle:.2f} times it ({low:.2f} to {high:.2f})"
        yield Line(f"run, {len(wanted)} studies{'' if report else ', before the report'}", "peak memory", told)


if __name__ == "__main__":
    for each in lines(sys.argv[1:]):
        print(each)
