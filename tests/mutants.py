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
GAZING, DISH, MOUNTS = "families/backward_gazing", "families/dish_tracking", "families/misalignment"
MUTANTS = [
    # Energy and its hours.
    Mutant(f"{FIELD}/values.py", "dni * air.hours * MEGA", "dni * MEGA", f"{KEYS}::test_energy_and_hours"),
    Mutant(
        f"{FIELD}/values.py",
        "air.hours[cause >= 0]",
        "(0 * air.hours + 1)[cause >= 0]",
        f"{KEYS}::test_energy_and_hours",
    ),
    Mutant(
        f"{FIELD}/values.py",
        "np.where(sun[:, 2] > 0, air.dni, 0.0)",
        "air.dni + 100.0",
        f"{KEYS}::test_energy_and_hours",
    ),
    Mutant("energy.py", "MEGA = 1e-6", "MEGA = 1e-3", f"{KEYS}::test_energy_and_hours"),
    Mutant(
        f"{FIELD}/values.py",
        "np.argsort(-each[index]",
        "np.argsort(each[index]",
        "tests/families/field_efficiency/test_energy.py",
    ),
    Mutant("grid/weather.py", "irradiance.wind.__gt__", "irradiance.wind.__lt__", f"{KEYS}::limits.wind_speed"),
    Mutant("grid/weather.py", "irradiance.dni.__lt__", "irradiance.dni.__gt__", f"{KEYS}::limits.dni"),
    # Weather files.
    Mutant(
        "config/weather_files.py",
        '"start": 0.5, "middle": 0.0, "end": -0.5',
        '"start": 0.5, "middle": 0.0, "end": 0.5',
        f"{KEYS}::weather.offset",
    ),
    Mutant(
        "config/weather_files.py",
        "step / 60 * _TO_MIDDLE[mark]",
        "_TO_MIDDLE[mark]",
        "tests/config/test_weather_files.py",
    ),
    Mutant(
        "config/weather_files.py",
        'return "start"',
        'return "end"',
        "tests/config/test_weather_cases.py",
    ),
    Mutant("config/times.py", "again & (second < first)", "again & (second > first)", "tests/config"),
    Mutant("config/times.py", "dt.timezone(-offset if", "dt.timezone(offset if", "tests/config/test_zones.py"),
    # Units and sweeps.
    Mutant(
        "config/values.py", '"arcmin": Decimal(1) / 60', '"arcmin": Decimal(1) / 3600', "tests/config/test_units.py"
    ),
    Mutant("config/values.py", 'Decimal(1) / Decimal("3.6")', 'Decimal("3.6")', "tests/config/test_units.py"),
    Mutant("config/values.py", '"MW/m2": 10**6', '"MW/m2": 10**9', "tests/config/test_units.py"),
    Mutant(
        "config/values.py",
        "whole = int(steps + _ON_STEP)",
        "whole = int(steps + _ON_STEP) - 1",
        "tests/config/test_sweep.py",
    ),
    Mutant(
        "config/values.py",
        "stats.lognorm(b, scale=a)",
        "stats.lognorm(b, loc=a)",
        "tests/config/test_drawn.py",
    ),
    Mutant("config/values.py", "CUT = 1e-6", "CUT = 1e-9", "tests/config/test_drawn.py::hardly"),
    # Sun.
    Mutant(
        "kernels/sun.py",
        "-np.cos(dec) * np.sin(angle)",
        "np.cos(dec) * np.sin(angle)",
        "tests/kernels/sun/test_clock.py",
    ),
    Mutant("kernels/sun.py", "284.0 + np.asarray(day", "274.0 + np.asarray(day", f"{KEYS}::solar-time.days"),
    Mutant(
        "kernels/sun.py",
        "np.radians(15.0) * (time - 12.0)",
        "np.radians(15.0) * (time - 11.0)",
        f"{KEYS}::solar-time.hours",
    ),
    Mutant("kernels/sun.py", "(pressure / 101000.0)", "(pressure / 101.0)", f"{KEYS}::ephemeris.pressure"),
    Mutant(
        "kernels/sun.py",
        "283.0 / (273.0 + temperature)",
        "(273.0 + temperature) / 283.0",
        f"{KEYS}::ephemeris.temperature",
    ),
    Mutant(f"{DISH}/compute.py", "100 * ephemeris.pressure", "ephemeris.pressure", f"{KEYS}::ephemeris.pressure"),
    Mutant(
        "sun.py",
        "np.cos(e) * np.sin(a), np.cos(e) * np.cos(a)",
        "np.cos(e) * np.cos(a), np.cos(e) * np.sin(a)",
        f"{KEYS}::field-time.azimuth",
    ),
    # Errors of the light, and mirrors.
    Mutant(
        f"{FIELD}/chain.py",
        'np.hypot(slope, values["tracking_error"])',
        "np.hypot(slope, 0.0)",
        f"{KEYS}::tracking_error",
    ),
    Mutant(
        f"{FIELD}/chain.py",
        '1e-3 * float(values["specularity_error"])',
        '0.5e-3 * float(values["specularity_error"])',
        f"{KEYS}::specularity_error",
    ),
    Mutant(f"{FIELD}/chain.py", "return clear * clean", "return clear", f"{KEYS}::light-optics.cleanliness"),
    Mutant(
        f"{FIELD}/chain.py", 'values["scale"] * widths_of(given)', "widths_of(given)", f"{KEYS}::mount_errors.scale"
    ),
    Mutant(
        f"{FIELD}/chain.py",
        'for key in ("azimuth", "tilt"))',
        'for key in ("tilt", "azimuth"))',
        f"{KEYS}::light-receiver",
    ),
    Mutant(
        f"{FIELD}/chain.py",
        "np.stack(mirrors[3:5], axis=1)",
        "np.stack(mirrors[4:2:-1], axis=1)",
        "tests/families/field_efficiency/test_optics.py",
    ),
    Mutant(
        f"{FIELD}/compute.py",
        "np.argsort(-values, kind",
        "np.argsort(values, kind",
        "tests/families/field_efficiency/test_keep.py",
    ),
    Mutant(f"{FIELD}/compute.py", ">= power else", "< power else", "tests/families/field_efficiency/test_keep.py"),
    Mutant(
        f"{FIELD}/compute.py",
        "field.study.design_point.dni * 1e-6",
        "field.study.design_point.dni * 1e-3",
        "tests/families/field_efficiency/test_keep.py",
    ),
    Mutant(
        f"{FIELD}/values.py",
        "(facets.columns - 1) * facets.gap",
        "facets.columns * facets.gap",
        "tests/families/field_efficiency",
    ),
    Mutant(f"{FIELD}/values.py", "1e-3 * total if power", "total if power", "tests/families/field_efficiency"),
    # Layouts.
    Mutant(
        "layouts/patterns.py", "1.1442399 / math.tan(t)", "1.1442399 * math.tan(t)", "tests/layouts/test_spacing.py"
    ),
    Mutant("layouts/patterns.py", "- 1.1255617 * t**2", "+ 1.1255617 * t**2", "tests/layouts/test_spacing.py"),
    Mutant(
        "layouts/patterns.py",
        "right * math.cos(turn) + ahead * math.sin(turn)",
        "right * math.cos(turn) - ahead * math.sin(turn)",
        "tests/layouts/test_patterns.py",
    ),
    Mutant(
        "layouts/patterns.py",
        "distance * np.sin(azimuth), distance * np.cos(azimuth), k, {",
        "distance * np.cos(azimuth), distance * np.sin(azimuth), k, {",
        "tests/layouts/test_patterns.py",
    ),
    Mutant(
        "layouts/ground.py",
        "-math.tan(math.radians(slope))",
        "math.tan(math.radians(slope))",
        f"{KEYS}::terrain.azimuth",
    ),
    Mutant(
        "layouts/paint.py",
        "squared = FLATTENING * (2 - FLATTENING)",
        "squared = FLATTENING",
        "tests/layouts/test_paint.py",
    ),
    # Mounts and spots.
    Mutant("kernels/mounts.py", "up), (-cosine, sine, 0.0)", "up), (cosine, -sine, 0.0)", "tests/kernels/spots"),
    Mutant(
        "kernels/mounts.py",
        "(-up * sine, -up * cosine, out)",
        "(up * sine, up * cosine, out)",
        "tests/kernels/spots",
    ),
    Mutant(
        f"{MOUNTS}/calibration.py",
        '"covariance": found.covariance * 1e6',
        '"covariance": found.covariance * 1e3',
        "tests/families/misalignment/test_calibration.py",
    ),
    Mutant(
        f"{MOUNTS}/calibration.py",
        "axis1=1, axis2=2)) * 1e3",
        "axis1=1, axis2=2)) * 1e6",
        "tests/families/misalignment/test_calibration.py",
    ),
    Mutant(
        f"{MOUNTS}/calibration.py",
        "deviation > LARGEST_DEVIATION",
        "deviation > 100 * LARGEST_DEVIATION",
        "tests/families/misalignment/test_calibration.py::disagree",
    ),
    Mutant(
        f"{MOUNTS}/calibration.py",
        "math.radians(-15.0 * hours)",
        "math.radians(15.0 * hours)",
        "tests/families/misalignment/test_calibration.py::another_reading",
    ),
    Mutant(
        "families/mount_errors.py",
        "2.0 * standard_uniforms(*which) - 1.0",
        "standard_uniforms(*which)",
        "tests/families/misalignment/test_draws.py",
    ),
    Mutant(
        f"{MOUNTS}/spots.py",
        "(np.abs(y) <= width) & (np.abs(z) <= height)",
        "(np.abs(y) <= height) & (np.abs(z) <= width)",
        "tests/families/misalignment",
    ),
    Mutant("config/values.py", "0.5 * second - 0.5 * first", "second - first", "tests/config/test_distribution.py"),
    # Draws, searches and tables for others.
    Mutant(
        "grid/statistics.py", "means.std(axis=-1, ddof=1)", "means.std(axis=-1)", f"{KEYS}::test_the_standard_error"
    ),
    Mutant("grid/statistics.py", "own.std(axis=-1, ddof=1)", "own.std(axis=-1)", "tests/families/sampled"),
    Mutant(
        "grid/statistics.py",
        "0.5 * np.mean((first - swapped)",
        "np.mean((first - swapped)",
        "tests/families/sampled/test_statistics.py",
    ),
    Mutant(
        "search/result.py",
        "(1 if least else -1), kind",
        "(-1 if least else 1), kind",
        "tests/search/test_search.py::test_the_table_of_the_best",
    ),
    Mutant("search/result.py", "sign * (bound - values[name])", "sign * (values[name] - bound)", "tests/search"),
    Mutant("share/electricity.py", '("D_rec", 2.0)', '("D_rec", 1.0)', "tests/share/test_electricity.py"),
    Mutant("share/electricity.py", "np.roll(kept, -", "np.roll(kept, ", "tests/share/test_electricity.py"),
    Mutant("share/sam.py", "(180.0 if south else 0.0)", "(0.0 if south else 180.0)", "tests/share/test_sam.py"),
    Mutant("share/sam.py", "np.argsort((180.0 - flux", "np.argsort((flux", "tests/share/test_sam.py"),
    Mutant(
        "share/sam.py",
        "_over_directions(result, variable, select) * factor",
        "_over_directions(result, variable, select)",
        "tests/share/test_sam.py",
    ),
    Mutant("share/sam.py", "next((name for name in _FACTORS", "next((name for name in ()", "tests/share/test_sam.py"),
]


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
