"""Verification of a result folder: the SHA-256 of the result, its study, and the chunks of an unfinished run."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from heliosweep.config.load import load
from heliosweep.errors import HeliosweepError, StudyError
from heliosweep.families.family import study_classes
from heliosweep.files import human_bytes, user_path
from heliosweep.store.folder import MANIFEST, STUDIES, is_locked, manifest_digest, read_manifest, unfinished
from heliosweep.store.read import result_digest


@dataclass(frozen=True)
class Verification:
    """Findings in a result folder.

    Parameters
    ----------
    folder : pathlib.Path
        The folder.
    finished : bool
        False if it holds parts of a result only.
    lines : tuple of str
        Undamaged and damaged contents, and remarks.
    ok : bool
        True if nothing is damaged or missing; an unfinished run with undamaged chunks is ok.
    """

    folder: Path
    finished: bool
    lines: tuple[str, ...]
    ok: bool

    def __str__(self) -> str:
        verdict = ("all right" if self.finished else "unfinished, all right so far") if self.ok else "NOT all right"
        return "\n".join([f"{self.folder}: {verdict}", *(f"  {line}" for line in self.lines)])


def verify(folder: str | os.PathLike[str]) -> Verification:
    """Check a result folder, finished or not, without changing it. Damage is reported, never raised."""
    place = user_path(folder)
    finished = (place / MANIFEST).exists() or unfinished(place) is None
    lines, ok = list[str](), True
    try:
        for undamaged, line in _of_finished(place) if finished else _of_chunks(place):
            lines.append(line)
            ok = ok and undamaged
    except (HeliosweepError, OSError, ValueError) as error:
        lines, ok = [*lines, str(error).removeprefix(f"{place}/")], False
    return Verification(place, finished, tuple(lines), ok)


def _of_finished(folder: Path) -> Iterator[tuple[bool, str]]:
    if not folder.is_dir():
        raise HeliosweepError("is no folder; name a result folder, or run the study")
    manifest = read_manifest(folder)
    path, study_id = folder / manifest["result"]["file"], manifest.get("study_id")
    if not path.exists():
        yield False, f"{path.name}: is missing"
    elif result_digest(path) != manifest["result"]["sha256"]:
        yield False, f"{path.name}: is not as written (SHA-256); run the study again"
    else:
        yield True, f"{path.name}: {human_bytes(path.stat().st_size)}, as written (SHA-256)"
    if manifest.get("digest", manifest_digest(manifest)) != manifest_digest(manifest):
        yield False, f"{MANIFEST}: is not as written (SHA-256)"
    study = next((folder / name for name in STUDIES if (folder / name).exists()), folder / STUDIES[0])
    try:
        loaded = load(study, study_classes()).study_id
        other = "" if loaded == study_id else f", and the result is of study {study_id}"
        yield not other, f"{study.name}: study {loaded}{other}"
    except StudyError as error:
        reason = str(error.problems[0]).removeprefix(f"{study}:")
        elsewhere = study.exists() and all("no such file" in str(problem) for problem in error.problems)
        yield (
            elsewhere,
            (
                f"note: {study.name}: cannot run here, since its files are not here: {reason}"
                if elsewhere
                else f"{study.name}: cannot be loaded: {reason}"
            ),
        )
    if not (folder / "report.html").is_file():
        yield True, f"note: there is no report.html; to draw it: heliosweep report {folder}"


def _of_chunks(folder: Path) -> Iterator[tuple[bool, str]]:
    store = unfinished(folder)
    assert store is not None
    done = sorted(store.done())
    damaged = [name for name in done if store.load(name) is None]
    yield True, f"{len(done) - len(damaged):,} of {store.record['chunks']:,} chunks are done"
    yield from ((False, f"chunk {name}: is damaged; the next run computes it again") for name in damaged)
    if is_locked(folder):
        yield True, "note: a run is active in it"
