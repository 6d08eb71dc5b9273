"""Small faults put into the code one at a time, and the test that must catch each: ``make mutants``.

Each mutant is applied to a copy of the package, and its test is run. A mutant that lives is a number without a test.
Name parts of files or tests to run some: ``python -m tests.mutants energy.py``.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PACKAGE = "pipeline/heliosweep"


class Mutant(NamedTuple):
    """A fault: file in the package, text, text in its place, and the test that catches it (with ``::name``)."""

    file: str
    old: str
    new: str
    test: str


def read(path: Path) -> list[Mutant]:
    """Read the mutants of a file, three lines each: ``@ file => test``, ``- text`` and ``+ text in its place``."""
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if line and not line.startswith("#")]
    found = []
    for place, old, new in zip(lines[::3], lines[1::3], lines[2::3], strict=True):
        file, test = place.removeprefix("@ ").split(" => ")
        found.append(Mutant(file, old.removeprefix("- "), new.removeprefix("+ "), test))
    return found


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
    chosen = [
        one
        for one in read(Path(__file__).with_suffix(".txt"))
        if not wanted or any(word in f"{one.file} {one.test}" for word in wanted)
    ]
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
