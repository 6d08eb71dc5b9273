"""Benchmarks by their names: `python -m tests.bench [NAME ...]`; without names the kernels, in one table."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator

from tests.bench.table import Row, show

#: What stands in the table.
KERNELS = ("field", "intercept", "chain", "dish", "deviation", "mount_spots", "calibration", "gazing", "gazing_lm")
#: Whole commands, with tables of their own.
COMMANDS = ("study", "engines", "memory", "parts")


def kernel_groups(names: list[str]) -> Iterator[Iterator[Row]]:
    """Rows of some benchmarks, with a word on what is being measured."""
    for name in names:
        print(f"measuring {name} ...", file=sys.stderr, flush=True)
        yield from (rows() for rows in importlib.import_module(f"tests.bench.bench_{name}").GROUPS)


def main(names: list[str]) -> None:
    """Print the table of the kernels named, then those of commands."""
    unknown = sorted(set(names) - {"kernels", *KERNELS, *COMMANDS})
    if unknown:
        raise SystemExit(f"no benchmark {', '.join(unknown)}; there are kernels, {', '.join((*KERNELS, *COMMANDS))}")
    kernels = [name for name in KERNELS if not names or "kernels" in names or name in names]
    if kernels:
        show(kernel_groups(kernels))
    for name in COMMANDS:
        if name in names:
            importlib.import_module(f"tests.bench.bench_{name}").main([])


if __name__ == "__main__":
    main(sys.argv[1:])
