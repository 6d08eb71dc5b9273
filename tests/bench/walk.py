"""The way of a small run through the package, `python -m tests.bench.walk`: files, functions and changes of layer.

The study has two latitudes and four heliostats, and is computed by threads. Counted are the functions of the package
that are called, the files that they are in, and the pairs of functions in different layers (folders, or modules beside
them) of which one calls the other. Bodies of modules and classes count as no functions. Kernels are loaded before.
"""

from __future__ import annotations

import sys
import tempfile
import threading
from pathlib import Path
from types import FrameType
from typing import Any

STUDY: dict[str, Any] = {
    "family": "field_efficiency",
    "site": {"latitude": [0, 40]},
    "tracking": "spinning_elevation",
    "time": {"clock": "solar", "days": [80], "hours": [9, 12], "sampling": "inclusive"},
    "layout": {"radial_stagger": {"clearance": 13, "inner_radius": 50, "heliostats": 4}},
    "heliostat": {"width": 9, "height": 8, "pivot_height": 5},
    "receiver": {"height": 60},
    "execution": {"scheduler": "threads", "workers": 2},
}
#: What Python calls the bodies of modules, and of code that is written in place.
_NOT_FUNCTIONS = ("<module>", "<listcomp>", "<dictcomp>", "<setcomp>", "<genexpr>", "<lambda>")


def walk(report: bool) -> tuple[set[str], set[tuple[str, str]], set[tuple[Any, Any]]]:
    """Files, functions and changes of layer of a run, with or without its report."""
    import yaml

    import heliosweep

    package = str(Path(heliosweep.__file__).parent) + "/"
    functions: set[tuple[str, str]] = set()
    changes: set[tuple[Any, Any]] = set()

    def own(frame: FrameType | None) -> tuple[str, str] | None:
        while frame is not None:
            code = frame.f_code
            if code.co_filename.startswith(package) and code.co_name not in _NOT_FUNCTIONS:
                return code.co_filename[len(package) :], code.co_qualname if sys.version_info >= (
                    3,
                    11,
                ) else code.co_name
            frame = frame.f_back
        return None

    def layer(path: str) -> str:
        return path.partition("/")[0]

    def called(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event != "call" or not code.co_filename.startswith(package) or code.co_name in _NOT_FUNCTIONS:
            return
        here, before = own(frame), own(frame.f_back)
        assert here is not None
        functions.add(here)
        if before and layer(before[0]) != layer(here[0]):
            changes.add((before, here))

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "study.yaml")
        path.write_text(yaml.safe_dump(STUDY))
        heliosweep.run(path, Path(folder, "before"), report=report)
        threading.setprofile(called)
        sys.setprofile(called)
        try:
            heliosweep.run(path, Path(folder, "out"), report=report)
        finally:
            sys.setprofile(None)
            threading.setprofile(None)
    return {file for file, _ in functions}, functions, changes


def main() -> None:
    """Print the counts."""
    for report in (False, True):
        files, functions, changes = walk(report)
        what = "with its report" if report else "without report"
        print(f"a small run {what}: {len(files)} files, {len(functions)} functions, {len(changes)} changes of layer")


if __name__ == "__main__":
    main()
