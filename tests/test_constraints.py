"""constraints.txt pins all that `make setup` installs."""

import re
import tomllib
from importlib import metadata

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.conftest import ROOT

EXTRAS = ("all", "test", "check", "docs")


def test_everything_is_pinned_to_one_version() -> None:
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    entries = [line for line in lines if not line.startswith("#")]
    assert len(entries) > 100
    for entry in entries:
        assert re.fullmatch(r"[\w.-]+==[\w.]+( ; .+)?", entry), entry
    pinned = {canonicalize_name(entry.split("==")[0]) for entry in entries}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    waiting = [*project["dependencies"], *(one for name in EXTRAS for one in project["optional-dependencies"][name])]
    seen: set[tuple[str, str]] = set()
    while waiting:
        wanted = Requirement(waiting.pop())
        for extra in ("", *wanted.extras):
            if (wanted.name, extra) in seen:
                continue
            seen.add((wanted.name, extra))
            if wanted.name == "heliosweep":
                waiting += project["optional-dependencies"].get(extra, [])
                continue
            more = map(Requirement, metadata.requires(wanted.name) or [])
            waiting += [str(one) for one in more if one.marker is None or one.marker.evaluate({"extra": extra})]
    assert {canonicalize_name(name) for name, _ in seen} - pinned == {"heliosweep"}
