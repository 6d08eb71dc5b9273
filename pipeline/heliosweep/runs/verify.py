"""Verification of a result folder: the SHA-256 of the result, its study, and the chunks of an unfinished run."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path

from heliosweep.config.load import load
from heliosweep.errors import HeliosweepError, StudyError
from heliosweep.families.family import study_classes
from heliosweep.files import human_bytes, user_path
from heliosweep.store.chunks import unfinished
from heliosweep.store.folder import MANIFEST, STUDIES, is_locked, manifest_digest, read_manifest
from heliosweep.store.read import result_bytes, result_digest


@dataclass
class Verification:
    """Findings in a result folder.

    Parameters
    ----------
    folder : pathlib.Path
        The folder.
    finished : bool
        False if it holds parts of a result only.
    found : list of str
        Undamaged contents.
    problems : list of str
        Damaged or missing contents.
    notes : list of str
        Remarks that do not concern the numbers.
    """

    folder: Path
    finished: bool = True
    found: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def ok(self) -> bool:
        """True if nothing is damaged or missing; an unfinished run with undamaged chunks is ok."""
        return not self.problems

    @property
    def lines(self) -> list[str]:
        """A heading and all findings."""
        verdict = ("all right" if self.finished else "unfinished, all right so far") if self.ok else "NOT all right"
        findings = [*self.found, *self.problems, *(f"note: {note}" for note in self.notes)]
        return [f"{self.folder}: {verdict}", *(f"  {line}" for line in findings)]

    @property
    def text(self) -> str:
        """The lines as one text."""
        return "\n".join(self.lines)


def verify(folder: str | os.PathLike[str]) -> Verification:
    """Check a result folder, finished or not, without changing it. Damage is reported, never raised."""
    place = user_path(folder)
    found = Verification(place)
    try:
        if not place.is_dir():
            found.problems.append("is no folder; name a result folder, or run the study")
        elif (place / MANIFEST).exists() or unfinished(place) is None:
            _check_finished(place, found)
        else:
            _check_unfinished(place, found)
    except (HeliosweepError, OSError, ValueError) as error:
        found.problems.append(str(error).removeprefix(f"{place}/"))
    return found


def _check_finished(folder: Path, found: Verification) -> None:
    manifest = read_manifest(folder)
    result = manifest["result"]
    path = folder / result["file"]
    if not path.exists():
        found.problems.append(f"{path.name}: is missing")
    elif result_digest(path) != result["sha256"]:
        found.problems.append(f"{path.name}: is not as written (SHA-256); run the study again")
    else:
        found.found.append(f"{path.name}: {human_bytes(result_bytes(path))}, as written (SHA-256)")
    if manifest.get("digest", manifest_digest(manifest)) != manifest_digest(manifest):
        found.problems.append(f"{MANIFEST}: is not as written (SHA-256)")
    _check_study(folder, manifest.get("study_id"), found)
    if not (folder / "report.html").is_file():
        found.notes.append(f"there is no report.html; to draw it: heliosweep report {folder}")


def _check_study(folder: Path, study_id: str | None, found: Verification) -> None:
    path = next((folder / name for name in STUDIES if (folder / name).exists()), None)
    if path is None:
        found.problems.append(f"{STUDIES[0]}: is missing")
        return
    try:
        loaded = load(path, study_classes()).study_id
    except StudyError as error:
        first = str(error.problems[0]).removeprefix(f"{path}:")
        if all("no such file" in str(problem) for problem in error.problems):
            found.notes.append(f"{path.name}: cannot run here, since its files are not here: {first}")
        else:
            found.problems.append(f"{path.name}: cannot be loaded: {first}")
        return
    if loaded == study_id:
        found.found.append(f"{path.name}: study {loaded}")
    else:
        found.problems.append(f"{path.name}: is study {loaded}, the result is of study {study_id}")


def _check_unfinished(folder: Path, found: Verification) -> None:
    found.finished = False
    store = unfinished(folder)
    assert store is not None
    done, total = sorted(store.done()), store.record["chunks"]
    damaged = [name for name in done if store.load(name) is None]
    found.found.append(f"{len(done) - len(damaged):,} of {total:,} chunks are done")
    found.problems += [f"chunk {name}: is damaged; the next run computes it again" for name in damaged]
    if is_locked(folder):
        found.notes.append("a run is active in it")
