"""Whole runs as a user starts them: `python -m tests.bench study`.

Time beside the kernels' own, peak memory, quick answers.

Each command runs in a process of its own, after one run that fills the cache of compiled code.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
TABLE_2 = ROOT / "studies" / "chong2012_table2.yaml"


def timed(*arguments: str) -> tuple[float, float]:
    """Run the command line; wall time [s] and peak memory [MB] of the process."""
    start = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, "-m", "heliosweep", *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    _, status, usage = os.wait4(process.pid, 0)
    if os.waitstatus_to_exitcode(status):
        raise SystemExit(f"heliosweep {' '.join(arguments)} failed")
    return time.perf_counter() - start, usage.ru_maxrss / 1024


def main(_arguments: list[str]) -> None:
    """Print one table."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(2):
            total, memory = timed("run", str(TABLE_2), "--output", folder)
        manifest = json.loads((Path(folder) / "manifest.json").read_text())
        kernels, instants = manifest["seconds"]["compute"], manifest["plan"]["evaluations"]
        rows += [
            ("Table 2, command to files", f"{total:.2f} s, peak memory {memory:.0f} MB"),
            ("  its kernels", f"{kernels:.2f} s for {instants / 1e6:.1f} million heliostat-instants"),
            ("  allowed: 1.5 kernels + 3 s", f"{1.5 * kernels + 3:.2f} s"),
        ]
    for arguments in (("--help",), ("validate", str(TABLE_2)), ("plan", str(TABLE_2))):
        best = min(timed(*arguments)[0] for _ in range(3))
        rows.append((f"heliosweep {arguments[0]}", f"{best:.2f} s"))
    width = max(len(name) for name, _ in rows)
    print("\nwhole commands, compiled code cached")
    for name, value in rows:
        print(f"  {name:{width}}  {value}")


if __name__ == "__main__":
    main([])
