"""The layers import one way only, and what must answer at once imports nothing heavy."""

import ast
import re
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import heliosweep

PACKAGE = Path(__file__).parent.parent / "pipeline" / "heliosweep"

#: Each layer may import itself and what stands left of it; kernels know of their sources alone.
ORDER = [
    "sources", "errors", "lazy", "files", "config", "kernels", "sun", "light", "aiming", "energy", "economics", "field",
    "dish", "mounts", "gazing", "layouts", "grid", "store", "report", "search", "families", "runs", "share", "accessor",
    "api", "commands", "cli",
]  # fmt: skip
#: Name of a module, or of an object in one, that is imported by its name.
NAMED = re.compile(r"heliosweep(\.[a-z_]+)+(:\w+)?")
HEAVY = {"numba", "xarray", "dask", "pandas", "matplotlib", "scipy", "pvlib", "netCDF4", "rich"}


def imported(path: Path, for_types: bool = True) -> set[str]:
    """Names of heliosweep that a file imports, wherever in it, also those that are for type checkers alone."""
    names: set[str] = set()
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.If) and not for_types and ast.unparse(node.test) == "TYPE_CHECKING":
            node.body = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and NAMED.fullmatch(node.value):
            names.add(node.value.replace(":", "."))
    if path.name == "study.py" and path.parent.name == "config":
        names.discard("heliosweep.api")  # Study.with_ loads the changed study
    return {name for name in names if name.startswith("heliosweep.")}


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.py")), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_go_one_way(path):
    layer = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    if layer in ("__init__", "__main__"):
        return
    for name in imported(path):
        other = name.split(".")[1]
        if other not in ORDER or other == layer:
            continue
        assert layer != "kernels" or other == "sources", f"kernels import {name}"
        assert ORDER.index(other) < ORDER.index(layer), f"{layer} imports {name}"


def test_no_module_imports_itself_by_way_of_others():
    paths = {".".join(("heliosweep", *path.relative_to(PACKAGE).with_suffix("").parts)): path
             for path in PACKAGE.rglob("*.py")}  # fmt: skip
    graph = {
        module: {name if name in paths else name.rpartition(".")[0] for name in imported(path, for_types=False)}
        for module, path in paths.items()
    }
    list(TopologicalSorter(graph).static_order())


def test_faces_and_the_studies_of_all_families_import_nothing_heavy():
    code = (
        "import sys, yaml, heliosweep, heliosweep.cli, heliosweep.api\n"
        "from heliosweep.families.family import families\n"
        "for family in families().values():\n"
        "    heliosweep.load(yaml.safe_load(family.example())).dimensions()\n"
        "print(*{name.partition('.')[0] for name in sys.modules})"
    )
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not HEAVY & set(loaded)


def test_the_public_names():
    assert dir(heliosweep) == sorted(heliosweep.__all__)
    assert all(getattr(heliosweep, name) is not None for name in heliosweep.__all__)
    assert heliosweep.RunInterrupted.exit_code == 4
    with pytest.raises(AttributeError, match="module 'heliosweep' has no attribute 'nothing'"):
        _ = heliosweep.nothing  # type: ignore[attr-defined]
