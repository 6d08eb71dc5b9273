"""Peak memory of whole runs, each in a process of its own: the memory that the system counts, looked at every 20 ms."""

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml

from tests.conftest import STUDIES

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
