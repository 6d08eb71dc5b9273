"""`heliosweep verify`: a result folder, finished or not, held against what was computed."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from heliosweep.errors import HeliosweepError, StudyError
from heliosweep.files import human_bytes, user_path
from heliosweep.store.checks import check, check_apart
from heliosweep.store.folder import MANIFEST, RESULTS, STUDIES, holder, manifest_digest, read_manifest, refuse_devices
from heliosweep.store.parts import WORKING, PartStore
from heliosweep.store.read import foreign, result_bytes, result_digest


@dataclass
class Verification:
    """What was found in a result folder, `finished` or with only parts of a result.

    `found` is as it should be, `problems` are what is damaged or missing, `notes` what is worth knowing and does not
    touch the numbers.
    """

    folder: Path
    finished: bool = True
    found: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def ok(self) -> bool:
        """True where nothing is damaged or missing; an unfinished run whose parts are whole is all right."""
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

    Damage of any kind is told in what is returned, and never raised.
    """
    place = user_path(folder)
    verification = Verification(place)
    try:
        if not place.is_dir():
            there = "is no folder" if place.exists() else "there is no such folder"
            verification.problems.append(f"{there}; name a result folder, or run the study")
            return verification
        refuse_devices(place)
        if (place / WORKING).is_dir() and not (place / MANIFEST).exists():
            _check_unfinished(place, verification)
        else:
            _check_finished(place, verification)
    except HeliosweepError as error:
        verification.problems.append(str(error).removeprefix(f"{place}/"))
    except OSError as error:
        verification.problems.append(f"cannot be read: {error.strerror or error}: {error.filename or place}")
    return verification


def _check_finished(folder: Path, verification: Verification) -> None:
    problems = verification.problems
    manifest: dict[str, Any] = {}
    try:
        manifest = read_manifest(folder)
    except HeliosweepError as error:
        problems.append(str(error))
    there = [name for name in RESULTS if (folder / name).exists()]
    name: str = manifest["result"]["file"] if manifest else next(iter(there), "result")
    path = folder / name
    if not path.exists():
        problems.append(f"{name}: is missing")
        return
    if path.is_dir() != (path.suffix == ".zarr"):
        problems.append(f"{name}: is a {'folder' if path.is_dir() else 'file'}, and must not be one")
        return
    if not manifest:  # all that can be said is whether it can be read
        problems += [f"{name}: {line}" for line in check_apart(path, None)]
        return
    _check_result(path, manifest, verification)
    if manifest.get("digest", manifest_digest(manifest)) != manifest_digest(manifest):
        problems.append(f"{MANIFEST}: is not what was written (SHA-256)")
    elif "digest" not in manifest:
        verification.notes.append(f"{MANIFEST}: has no digest of its own; a change in it may not be noticed")
    _check_study(folder, manifest, verification)
    if path.is_dir() and (others := foreign(path)):
        more = f" and {len(others) - 1:,} more" if len(others) > 1 else ""
        verification.notes.append(f"{name}: holds files that are none of Zarr's, and no harm: {others[0]}{more}")
    if not (folder / "report.html").is_file():
        verification.notes.append(f"there is no report.html; to draw it: heliosweep report {folder}")
    if (folder / WORKING).is_dir():
        verification.notes.append(f"{WORKING}: parts of an unfinished run are there too")


def _check_result(path: Path, manifest: Mapping[str, Any], verification: Verification) -> None:
    """Compare the bytes of a result with its manifest, and what it holds."""
    name, problems, expected = path.name, verification.problems, manifest["result"]
    whole = path.is_dir() or path.stat().st_size == expected.get("bytes")
    if not whole:
        size = path.stat().st_size
        problems.append(f"{name}: has {size:,} bytes, {MANIFEST} says {expected.get('bytes')!r}")
    whole = whole and result_digest(path) == expected["sha256"]
    # What a file holds is only looked at in this process when its bytes are known to be right.
    wrong = (check if whole else check_apart)(path, manifest)
    problems += [f"{name}: {line}" for line in wrong]
    if not whole:
        rest = "" if wrong else "; what it holds is right, so that heliosweep compare finds no difference"
        problems.append(f"{name}: its bytes are not those that were written (SHA-256){rest}")
    elif wrong:
        problems.append(f"{MANIFEST}: is damaged: the bytes of the result are as it says, and the content is not")
    else:
        count = len((manifest.get("slabs") or {}).get("digests", ()))
        said = f", {count:,} slab{'s' if count > 1 else ''} as computed" if count else ""
        verification.found.append(f"{name}: {human_bytes(result_bytes(path))}; bytes and content as written{said}")


def _check_study(folder: Path, manifest: Mapping[str, Any], verification: Verification) -> None:
    from heliosweep.config.load import load
    from heliosweep.families.family import study_classes

    path = next((folder / name for name in STUDIES if (folder / name).exists()), folder / STUDIES[0])
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


def _check_unfinished(folder: Path, verification: Verification) -> None:
    verification.finished = False
    with PartStore.open(folder / WORKING) as store:
        damaged = list(store.damaged())
        done, failed, count = len(store.done) - len(damaged), len(store.failed), store.part_count
    verification.found.append(
        f"{done:,} of {count:,} parts are done, {failed:,} failed, {count - done - failed:,} are left to compute"
    )
    for part in damaged:
        where = ", ".join(f"{dim} [{span.start}] to [{span.stop - 1}]" for dim, span in part.region.items())
        verification.problems.append(f"part {part.name} ({where}): is not what was computed; it is computed anew")
    verification.problems += [f"part {name}: failed: {why}" for name, why in sorted(store.failed.items())]
    if who := holder(folder):
        verification.notes.append(f"{who} is at work in it now")
    if any((folder / name).exists() for name in RESULTS):
        verification.notes.append("a result is there without its manifest; run the study again to complete it")
