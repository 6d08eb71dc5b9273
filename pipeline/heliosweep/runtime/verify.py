"""`heliosweep verify`: whether a result folder still holds what was computed."""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from heliosweep.errors import HeliosweepError, StudyError
from heliosweep.grid.limits import human_bytes
from heliosweep.store import working
from heliosweep.store.contents import check, check_apart, check_parts, read_part, read_parts
from heliosweep.store.digest import file_digest, foreign, tree, tree_digest
from heliosweep.store.finished import MANIFEST, read_manifest
from heliosweep.store.journal import Journal
from heliosweep.store.raw import RESULTS, is_part, open_raw

__all__ = ["Verification", "read_part", "read_parts", "verify"]


@dataclass
class Verification:
    """What was found in a result folder.

    Parameters
    ----------
    folder : pathlib.Path
        The folder.
    finished : bool
        Whether it holds a result, not only parts of one.
    found : list of str
        What is as it should be.
    problems : list of str
        What is damaged or missing.
    notes : list of str
        What is worth knowing and does not touch the numbers.
    """

    folder: Path
    finished: bool = True
    found: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def ok(self) -> bool:
        """Whether nothing is damaged or missing; an unfinished run whose parts are whole is all right."""
        return not self.problems

    @property
    def lines(self) -> list[str]:
        """All of it, a heading first."""
        what = ("all right" if self.finished else "unfinished, all right so far") if self.ok else "NOT all right"
        said = [*self.found, *self.problems, *(f"note: {note}" for note in self.notes)]
        return [f"{self.folder}: {what}", *(f"  {line}" for line in said)]

    @property
    def text(self) -> str:
        """The lines as one text."""
        return "\n".join(self.lines)


def verify(folder: str | os.PathLike[str]) -> Verification:
    """Check a result folder, finished or not; nothing in it is changed.

    Parameters
    ----------
    folder : path
        Result folder.

    Returns
    -------
    Verification
        Damage of any kind is told in it, and never raised.
    """
    place = Path(folder)
    verification = Verification(place)
    try:
        if not place.is_dir():
            there = "is no folder" if place.exists() else "there is no such folder"
            verification.problems.append(f"{there}; name a result folder")
        elif (place / working.NAME).is_dir() and not (place / MANIFEST).exists():
            _check_unfinished(place, verification)
        else:
            _check_finished(place, verification)
    except OSError as error:
        verification.problems.append(f"cannot be read: {error.strerror or error}: {error.filename or place}")
    return verification


def _check_finished(folder: Path, verification: Verification) -> None:
    problems = verification.problems
    manifest = _manifest(folder, problems)
    path = _result(folder, manifest, problems)
    if path is None:
        return
    if not manifest:
        _check_alone(path, problems)
        return
    expected = manifest["result"]
    with ThreadPoolExecutor(1) as pool:
        try:
            # Both read the whole result; side by side they take the time of the slower one.
            digest = pool.submit(tree_digest if path.is_dir() else file_digest, path)
            whole = path.is_dir() or path.stat().st_size == expected.get("bytes")
            if not whole:
                problems.append(
                    f"{path.name}: has {path.stat().st_size:,} bytes, manifest.json says {expected.get('bytes')!r}"
                )
            # What a file holds is only looked at in this process when its bytes are known to be right.
            wrong = check(path, manifest) if path.is_dir() else None
            whole = digest.result() == expected.get("sha256") and whole
        except (OSError, ValueError, TypeError) as error:
            problems.append(f"{path.name}: cannot be read: {error}")
            return
    if wrong is None:
        wrong = (check if whole else check_apart)(path, manifest)
    problems += [f"{path.name}: {line}" for line in wrong]
    if not whole:
        rest = "" if wrong else "; what it holds is right, so that heliosweep compare finds no difference"
        problems.append(f"{path.name}: its bytes are not those that were written (SHA-256){rest}")
    elif wrong:
        problems.append(f"{MANIFEST}: is damaged: the bytes of the result are as it says, and the content is not")
    if whole and not wrong:
        size = human_bytes(sum(tree(path).values()) if path.is_dir() else path.stat().st_size)
        parts = manifest.get("parts")
        count = len(parts["digests"]) if parts else 0
        said = f", {count:,} part{'s' if count > 1 else ''} as computed" if count else ""
        verification.found.append(f"{path.name}: {size}; bytes and content as written{said}")
    _check_study(folder, manifest, verification)
    _check_rest(folder, path, verification)


def _manifest(folder: Path, problems: list[str]) -> dict[str, Any]:
    """The manifest, or nothing of it where it is damaged."""
    try:
        return read_manifest(folder)
    except HeliosweepError as error:
        problems.append(str(error))
    return {}


def _result(folder: Path, manifest: Mapping[str, Any], problems: list[str]) -> Path | None:
    """The result that the manifest names, or else the one that is there."""
    said = manifest["result"]["file"] if manifest else None
    names = [said] if said else [name for name in RESULTS if (folder / name).exists()]
    if not names or not (folder / names[0]).exists():
        problems.append(f"{said or 'result'}: is missing")
        return None
    path = folder / names[0]
    if path.is_dir() != (path.suffix == ".zarr"):
        problems.append(f"{path.name}: is a {'folder' if path.is_dir() else 'file'}, and must not be one")
        return None
    return path


def _check_alone(path: Path, problems: list[str]) -> None:
    """All that can be said of a result without its manifest: whether it is one."""
    manifest: dict[str, Any] = {"result": {}}
    wrong = check(path, manifest) if path.is_dir() else check_apart(path, manifest)
    problems += [f"{path.name}: {line}" for line in wrong if "manifest.json" not in line]


def _check_study(folder: Path, manifest: Mapping[str, Any], verification: Verification) -> None:
    from heliosweep.config.load import load
    from heliosweep.families.registry import study_classes

    names = ("study.resolved.yaml", "study.yaml")  # of a run, and of an unpacked archive
    path = next((folder / name for name in names if (folder / name).exists()), folder / names[0])
    if not path.exists():
        verification.problems.append(f"{path.name}: is missing")
        return
    try:
        found = load(path, study_classes()).study_id
    except StudyError as error:
        first = str(error.problems[0]).removeprefix(f"{path}:")
        if all("no such file" in str(problem) for problem in error.problems):
            verification.notes.append(f"{path.name}: files that it names are not here, so it cannot run here: {first}")
        else:
            verification.problems.append(f"{path.name}: cannot be loaded: {first}")
        return
    if found != manifest.get("study_id"):
        verification.problems.append(f"{path.name}: is study {found}, the result is of {manifest.get('study_id')}")
    else:
        verification.found.append(f"{path.name}: study {found}")


def _check_rest(folder: Path, path: Path, verification: Verification) -> None:
    if path.is_dir() and (others := foreign(path)):
        more = f" and {len(others) - 1:,} more" if len(others) > 1 else ""
        verification.notes.append(f"{path.name}: holds files that are none of Zarr's, and no harm: {others[0]}{more}")
    if not (folder / "report.html").is_file():
        verification.notes.append(f"there is no report.html; to draw it: heliosweep report {folder}")
    if (folder / working.NAME).is_dir():
        verification.notes.append(f"{working.NAME}: parts of an unfinished run are there too")


def _check_unfinished(folder: Path, verification: Verification) -> None:
    from heliosweep.store.claim import holder

    verification.finished = False
    place = folder / working.NAME
    try:
        identity = working.read_identity(place)
        counts = working.part_counts(place, identity)
        journal = Journal.read(place / "journal.jsonl")
        journal.keep(lambda name: is_part(name, counts))
        with open_raw(place / "values.zarr") as raw:
            count, damaged = check_parts(raw, identity["cut"], journal.done)
    except HeliosweepError as error:
        verification.problems.append(str(error).removeprefix(f"{folder}/"))
        return
    done, failed = len(journal.done) - len(damaged), len(journal.failed)
    verification.found.append(
        f"{done:,} of {count:,} parts are done, {failed:,} failed, {count - done - failed:,} are left to compute"
    )
    verification.problems += damaged
    verification.problems += [f"part {name}: failed: {why}" for name, why in sorted(journal.failed.items())]
    if who := holder(folder):
        verification.notes.append(f"{who} is at work in it now")
    if any((folder / name).exists() for name in RESULTS):
        verification.notes.append("a result is there without its manifest; run the study again to complete it")
