"""Test a wheel in an empty environment: run a study and the scripts of the gallery, outside of the repository.

usage: python tests/wheel.py dist/heliosweep-VERSION-py3-none-any.whl
"""

import subprocess
import sys
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).parents[1]
CONSTRAINTS = ROOT / "constraints.txt"
CHECK = """
import heliosweep, xarray
result = xarray.open_dataset("result/result.nc")
assert result["field_optical_efficiency"].notnull().all()
assert heliosweep.open_result("result").attrs["study_id"] == result.attrs["study_id"]
print("heliosweep", heliosweep.__version__, "runs from its wheel")
"""
DRAW = "import matplotlib, runpy, sys; matplotlib.use('agg'); runpy.run_path(sys.argv[1])"


def main(wheel: str) -> None:
    """Install the wheel into a new environment, run a shipped study and the scripts."""
    with tempfile.TemporaryDirectory() as folder:
        venv.create(folder, with_pip=True)
        binaries = Path(folder) / "bin"

        def run(*command: object) -> None:
            subprocess.run([str(part) for part in command], cwd=folder, check=True)

        run(binaries / "python", "-m", "pip", "install", "-q", "-c", CONSTRAINTS, Path(wheel).resolve())
        run(binaries / "heliosweep", "examples", "chong2012_table1", "--to", "studies")
        run(binaries / "heliosweep", "run", "studies/chong2012_table1.yaml", "-o", "result", "--no-report")
        run(binaries / "python", "-c", CHECK)
        for script in sorted((ROOT / "docs" / "scripts").glob("plot_*.py")):
            run(binaries / "python", "-c", DRAW, script)


if __name__ == "__main__":
    main(sys.argv[1])
