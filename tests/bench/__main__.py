"""Benchmarks by their names: `python -m tests.bench [NAME ...]`; without names the kernels.

With `--page=docs/scaling.md` the lines become the table of that page, with machine and date; README.md has some.
"""

import importlib
import sys
from pathlib import Path

from tests.bench.table import README_LINES, Line, print_lines, write_page
from tests.conftest import ROOT

KERNELS = ("field", "rays", "compile")
#: Whole commands, and comparisons with SolarPILOT and SAM.
COMMANDS = ("study", "chain", "electricity")


def main(arguments: list[str]) -> None:
    """Print the lines of the benchmarks named, and write them into a page if one is named."""
    page = next((Path(each.removeprefix("--page=")) for each in arguments if each.startswith("--page=")), None)
    names = [each for each in arguments if not each.startswith("--page=")] or ["kernels"]
    unknown = sorted(set(names) - {"kernels", *KERNELS, *COMMANDS})
    if unknown:
        raise SystemExit(f"no benchmark {', '.join(unknown)}; there are kernels, {', '.join((*KERNELS, *COMMANDS))}")
    lines: list[Line] = []
    for name in (*KERNELS, *COMMANDS):
        if name in names or (name in KERNELS and "kernels" in names):
            print(f"\n{name}")
            lines += print_lines(importlib.import_module(f"tests.bench.bench_{name}").lines())
    if page:
        write_page(page, lines)
        if len(chosen := [line for line in lines if line.ran in README_LINES]) == len(README_LINES):
            write_page(ROOT / "README.md", chosen)


if __name__ == "__main__":
    main(sys.argv[1:])
