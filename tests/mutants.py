"""Small faults put into the code one at a time, and the test that must catch each: ``make mutants``.

Each mutant is applied to a copy of the package, and its test is run. A mutant that lives is a number without a test.
Name parts of files or tests to run some: ``python -m tests.mutants energy.py``.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PACKAGE = "pipeline/heliosweep"
KEYS = "tests/test_keys_reach_numbers.py"


class Mutant(NamedTuple):
    """A fault: file in the package, text, text in its place, and the test that catches it (with ``::name``)."""

    file: str
    old: str
    new: str
    test: str


FIELD = "families/field_efficiency"
MUTANTS = [
    # Energy and its hours.
    Mutant(f"{FIELD}/energy.py", "dni * air.hours * _MEGA", "dni * _MEGA", f"{KEYS}::test_energy_and_hours"),
    Mutant(f"{FIELD}/energy.py", "air.hours[cause >= 0]", "(0 * air.hours + 1)[cause >= 0]",
           f"{KEYS}::test_energy_and_hours"),
    # Errors of the light.
    Mutant(f"{FIELD}/chain.py", 'values["tracking_error"])', "0.0)", f"{KEYS}::tracking_error"),
    Mutant(f"{FIELD}/chain.py", '1e-3 * float(values["specularity_error"])',
           '0.5e-3 * float(values["specularity_error"])',
           f"{KEYS}::specularity_error"),
    # Refraction.
    Mutant("families/dish_tracking/windows.py", "100 * ephemeris.pressure", "ephemeris.pressure",
           f"{KEYS}::ephemeris.pressure"),
    # Draws and searches.
    Mutant("grid/statistics.py", "means.std(axis=-1, ddof=1)", "means.std(axis=-1)",
           f"{KEYS}::test_the_standard_error"),
    Mutant("search/result.py", "np.argsort(signed[0][kept]", "np.argsort(-signed[0][kept]",
           "tests/search/test_search.py::test_the_table_of_the_best"),
]  # fmt: skip


def applied(mutant: Mutant, folder: Path) -> str:
    """Apply a mutant to a copy and return the original text. Raises ValueError if its text is not there once."""
    path = folder / PACKAGE / mutant.file
    text = path.read_text(encoding="utf-8")
    if text.count(mutant.old) != 1:
        raise ValueError(f"{mutant.file}: {mutant.old!r} is there {text.count(mutant.old)} times")
    path.write_text(text.replace(mutant.old, mutant.new), encoding="utf-8")
    return text


def passes(mutant: Mutant, folder: Path) -> bool:
    """Run the test of a mutant against a copy of the package; True if nothing fails."""
    place, _, name = mutant.test.partition("::")
    command = [sys.executable, "-m", "pytest", "-q", "-x", "--no-header", "-p", "no:cacheprovider", place]
    command += ["-k", name.replace(".", " and ")] if name else []
    environment = {**os.environ, "PYTHONPATH": str(folder / "pipeline")}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1):
        raise ValueError(f"{mutant.test}: {done.stdout[-300:]}{done.stderr[-300:]}")
    return done.returncode == 0


def main(wanted: list[str]) -> int:
    """Run the mutants, print one line for each, and return 1 if one lives or does not fit the code."""
    chosen = [one for one in MUTANTS if not wanted or any(word in f"{one.file} {one.test}" for word in wanted)]
    bad = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(ROOT / PACKAGE, folder / PACKAGE)
        for number, mutant in enumerate(chosen, 1):
            path = folder / PACKAGE / mutant.file
            text = path.read_text(encoding="utf-8") if path.exists() else ""
            try:
                applied(mutant, folder)
                state = "LIVES" if passes(mutant, folder) else "caught"
            except (ValueError, OSError) as error:
                state = f"DOES NOT FIT ({error})"
            finally:
                if text:
                    path.write_text(text, encoding="utf-8")
            bad += state != "caught"
            print(f"{number:3} of {len(chosen)}  {state}: {mutant.file}: {mutant.old!r}, {mutant.new!r}", flush=True)
    print(f"{len(chosen) - bad} of {len(chosen)} are caught")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
