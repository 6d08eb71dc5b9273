"""What the digest of numbers depends on, and what it does not."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import heliosweep
from heliosweep import sources
from heliosweep.sources import numbers_digest

MODULES = ("heliosweep.kernels.field.efficiency", "heliosweep.grid.sun", "heliosweep.store.encoding")


@pytest.fixture
def package(tmp_path):
    """A copy of the package."""
    source = Path(heliosweep.__file__).parent
    shutil.copytree(source, tmp_path / "heliosweep", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path / "heliosweep"


@pytest.fixture
def own(tmp_path):
    """A package beside this one, whose module imports another relative to itself."""
    folder = tmp_path / "own"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (folder / "compute.py").write_text(
        '"""Numbers."""\n'
        "from typing import TYPE_CHECKING\n"
        "from heliosweep import errors\n"
        "from . import table\n"
        "if TYPE_CHECKING:\n"
        "    from own import types\n"
        "class Model:\n"
        "    width: Length = 3.0\n"
        "def area(a: float) -> float:\n"
        "    # a comment\n"
        "    if a < 0.0:\n"
        "        raise errors.HeliosweepError(f'{a} is too small')\n"
        "    return a**2\n"
    )
    (folder / "table.py").write_text("ONE = 1.0\n")
    (folder / "types.py").write_text("")
    (tmp_path / "heliosweep").mkdir()
    (tmp_path / "heliosweep" / "errors.py").write_text("WORDS = 'words'\n")
    return folder


def digest(package, *modules):
    """Digest of the files as they are now."""
    sources._module.cache_clear()
    sources._source.cache_clear()
    return numbers_digest(*modules, root=package.parent)


@pytest.mark.parametrize(
    ("name", "counts"),
    [
        ("kernels/field/efficiency.py", True), ("kernels/field/polygons.py", True), ("kernels/sun/clock.py", True),
        ("grid/clock.py", True), ("store/encoding.py", True), ("store/identity.py", False),
        ("kernels/dish.py", False), ("families/misalignment/curves.py", False),
        ("report/page.py", False), ("runs/run.py", False), ("errors.py", False), ("cli.py", False),
    ],
)  # fmt: skip
def test_modules_that_numbers_depend_on(package, name, counts):
    before = digest(package, *MODULES)
    with (package / name).open("a") as file:
        file.write("ANOTHER = 1\n")
    assert (digest(package, *MODULES) != before) == counts


@pytest.mark.parametrize(
    ("name", "old", "new", "counts"),
    [
        ("compute", "a**2", "a**3", True),
        ("compute", "a < 0.0", "a < 1.0", True),
        ("compute", "width: Length", "width: Angle", True),
        ("compute", "width: Length = 3.0", "width: Length = 3", True),
        ("compute", "HeliosweepError", "RuntimeError", True),
        ("table", "1.0", "2.0", True),
        ("compute", "Numbers", "More words", False),
        ("compute", "    # a comment\n", "", False),
        ("compute", "a: float) -> float", "a: int) -> int", False),
        ("compute", "is too small", "must be larger", False),
        ("compute", "a**2\n", "(\n        a ** 2)\n", False),
        ("types", "", "ONE = 2.0\n", False),
    ],
)
def test_code_counts_and_words_do_not(own, name, old, new, counts):
    before = digest(own, "own.compute")
    path = own / f"{name}.py"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))
    assert (digest(own, "own.compute") != before) == counts


def test_a_renamed_module(own):
    before = digest(own, "own.compute")
    (own / "table.py").rename(own / "tables.py")
    (own / "compute.py").write_text((own / "compute.py").read_text().replace("import table", "import tables as table"))
    assert digest(own, "own.compute") != before


def test_modules_are_found_as_python_finds_them(own, monkeypatch):
    monkeypatch.syspath_prepend(str(own.parent))
    assert numbers_digest("own.compute") == digest(own, "own.compute")
    for name in ("own.missing", "no_such_package.compute"):
        with pytest.raises(ModuleNotFoundError):
            numbers_digest(name)


def test_what_was_parsed_is_remembered_on_disk_and_a_torn_memory_is_of_no_account(tmp_path):
    program = (
        "import ast; from heliosweep import sources; calls, parse = [], ast.parse\n"
        "ast.parse = lambda text: calls.append(text) or parse(text)\n"
        "print(sources.numbers_digest('heliosweep.kernels.sun.clock'), len(calls))"
    )

    def run():
        environment = {"PYTHONPATH": str(Path(heliosweep.__file__).parents[1]), "NUMBA_CACHE_DIR": str(tmp_path)}
        command = [sys.executable, "-c", program]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.split()

    first, second = run(), run()
    (memory,) = tmp_path.iterdir()
    memory.write_text("[")
    third = run()
    assert first[0] == second[0] == third[0]
    assert first[1] != "0" == second[1]
    assert third[1] == first[1]


MODULE = "heliosweep.families.dish_tracking.compute"


@pytest.fixture
def _forget():
    sources.code_versions.cache_clear()
    yield
    sources.code_versions.cache_clear()


def test_libraries_are_named():
    versions = sources.code_versions(MODULE)
    assert versions["numpy"] == sources.version_of("numpy")
    assert all(isinstance(version, str) for version in versions.values())
    assert "missing" not in versions.values()


@pytest.mark.usefixtures("_forget")
def test_another_library(monkeypatch):
    before = sources.code_versions(MODULE)
    sources.code_versions.cache_clear()
    monkeypatch.setattr(sources, "version_of", lambda name: "1.0")
    assert sources.code_versions(MODULE) != before


def test_each_family_has_its_own():
    names = [f"heliosweep.families.{name}.compute" for name in ("dish_tracking", "field_efficiency")]
    assert len({sources.code_versions(name)["heliosweep"] for name in names}) == 2
