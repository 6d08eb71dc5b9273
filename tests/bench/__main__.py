"""Benchmarks by their names: `python -m tests.bench [NAME ...]`; without names the kernels, in one table.

With `--page=docs/scaling.md` as well, all that was measured becomes the one table of that page, with machine and date.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path

from tests.bench.table import Row, print_lines, show, write_page

#: What stands in the table.
KERNELS = (
    "field",
    "rays",
    "chain",
    "dish",
    "deviation",
    "mount_spots",
    "calibration",
    "gazing",
    "gazing_lm",
    "compile",
)
#: Whole commands, a line for each.
COMMANDS = ("study", "studies", "engines", "memory")


def kernel_groups(names: list[str]) -> Iterator[Iterator[Row]]:
    """Rows of some benchmarks, with a word on what is being measured."""
    for name in names:
        print(f"measuring {name} ...", file=sys.stderr, flush=True)
        yield from (rows() for rows in importlib.import_module(f"tests.bench.bench_{name}").GROUPS)


def main(arguments: list[str]) -> None:
    """Print the table of the kernels named, then lines of commands; write them into a page where one is named."""
    page = next((Path(each.removeprefix("--page=")) for each in arguments if each.startswith("--page=")), None)
    names = [each for each in arguments if not each.startswith("--page=")]
    unknown = sorted(set(names) - {"kernels", *KERNELS, *COMMANDS})
    if unknown:
        raise SystemExit(f"no benchmark {', '.join(unknown)}; there are kernels, {', '.join((*KERNELS, *COMMANDS))}")
    kernels = [name for name in KERNELS if not names or "kernels" in names or name in names]
    told = show(kernel_groups(kernels)) if kernels else []
    for name in COMMANDS:
        if name in names:
            print(f"\n{name}")
            told += print_lines(importlib.import_module(f"tests.bench.bench_{name}").lines())
    if page:
        write_page(page, told)


if __name__ == "__main__":
    main(sys.argv[1:])
