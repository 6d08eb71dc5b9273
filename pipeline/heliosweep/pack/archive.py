"""`heliosweep pack`: a result folder as one archive to publish."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from heliosweep.config.citable import licence as licence_of
from heliosweep.config.faults import Invalid
from heliosweep.config.load import load
from heliosweep.config.study import Study
from heliosweep.errors import FORCE, HeliosweepError, Problem, StudyError
from heliosweep.families.registry import study_classes
from heliosweep.pack import inputs
from heliosweep.pack.crate import METADATA, crate
from heliosweep.pack.described import Column, Described
from heliosweep.pack.licences import DEFAULT, Licence
from heliosweep.pack.notebook import notebook
from heliosweep.pack.readme import citation, readme
from heliosweep.pack.zipped import Archive, writing
from heliosweep.runtime.verify import verify
from heliosweep.store.digest import tree
from heliosweep.store.raw import Raw, open_raw

log = logging.getLogger("heliosweep")

_STUDIES = ("study.resolved.yaml", "study.yaml")


def pack_result(
    folder: str | os.PathLike[str],
    output: str | os.PathLike[str] | None = None,
    *,
    license: str | None = None,
    force: bool = False,
) -> Path:
    """Write a result folder as one archive that opens, verifies and reruns anywhere.

    Parameters
    ----------
    folder : path
        Result folder, finished and whole.
    output : path, optional
        The archive, ``NAME.zip``; by default beside the folder and named like it.
    license : str, optional
        Licence of the data, an SPDX identifier or ``LicenseRef-NAME``; by default that of the study, or else CC-BY-4.0.
    force : bool
        Whether to replace an archive that is there.

    Returns
    -------
    pathlib.Path
        The archive. Its bytes depend on the result folder alone.

    Raises
    ------
    HeliosweepError
        Where the result is unfinished or damaged, an input of the study is missing or changed, or the archive cannot
        be written.
    StudyError
        Where the archive cannot have the name, or the licence is unknown.
    """
    place = Path(folder)
    target = _target(place, output, force)
    if license is not None:
        _checked(license)
    found = verify(place)
    if not (found.ok and found.finished):
        raise HeliosweepError(f"not packed, for only a whole result is:\n{found.text}")
    study = load(next(place / name for name in _STUDIES if (place / name).exists()), study_classes())
    places = inputs.placed(study)
    manifest = json.loads((place / "manifest.json").read_text(encoding="utf-8"))
    if study.study_id != manifest["study_id"]:
        raise HeliosweepError(f"{place}: an input of the study was changed since it ran")
    licence = _licence(study, license)
    if str(manifest.get("environment", {}).get("commit", "")).endswith("-dirty"):
        log.warning("the result was computed by a heliosweep with changes that its commit does not hold (-dirty)")
    result = place / manifest["result"]["file"]
    with open_raw(result) as raw:
        described = _described(study, inputs.cleaned(manifest), raw, places, licence)
    top = f"{study.family}-{study.study_id}"
    try:
        with writing(target, top) as archive:
            _fill(archive, described, result, {places[name]: study.resolve(name) for name in places}, places)
    except OSError as error:
        raise HeliosweepError(f"{target}: cannot be written: {error.strerror or error}") from error
    return target


def _target(folder: Path, output: str | os.PathLike[str] | None, force: bool) -> Path:
    named = folder if folder.name not in ("", "..") else folder.resolve()
    target = named.with_name(f"{named.name}.zip") if output is None else Path(output)
    if target.suffix.lower() != ".zip":
        raise StudyError(Problem("an archive's name ends with .zip", file=str(target)))
    if target.is_dir():
        raise StudyError(Problem("is a folder", file=str(target)))
    if target.exists() and not force:
        raise StudyError(Problem(f"is there already; {FORCE} replaces it", file=str(target)))
    if not target.absolute().parent.is_dir():
        raise StudyError(Problem("its folder does not exist", file=str(target)))
    return target


def _licence(study: Study, given: str | None) -> Licence:
    said = given if given is not None else (study.dataset.license if study.dataset else None)
    if said is None:
        log.warning("the licence of the data is %s; --license, or dataset.license in the study, names another", DEFAULT)
    if study.dataset is None or not study.dataset.creators:
        log.warning("nobody is named as creator; dataset.creators in the study does")
    return Licence(said or DEFAULT)


def _checked(license: str) -> None:
    """Refuse what is no licence."""
    try:
        licence_of(license)
    except Invalid as error:
        raise StudyError(Problem(f"{license!r} {error}", key="--license")) from error


def _described(
    study: Study, manifest: Mapping[str, Any], raw: Raw, places: Mapping[str, str], licence: Licence
) -> Described:
    columns = {
        name: Column(
            name,
            _units(variable.attributes),
            str(variable.attributes.get("long_name", "")),
            variable.dims,
        )
        for name, variable in raw.variables.items()
    }
    coordinates = set(raw.coordinates)
    named = {places[name]: key for key, names in study.files().items() for name in names}
    return Described(
        study,
        manifest,
        raw.attributes,
        raw.sizes,
        [column for name, column in columns.items() if name in coordinates],
        [column for name, column in columns.items() if name not in coordinates],
        dict(sorted(named.items())),
        licence,
    )


def _units(attributes: Mapping[str, Any]) -> str:
    """Units as readers of a table know them; times are decoded when the result is opened."""
    units = str(attributes.get("units", ""))
    return "date" if " since " in units else units


def _fill(
    archive: Archive, described: Described, result: Path, files: Mapping[str, Path], places: Mapping[str, str]
) -> None:
    """Write everything in one fixed order, the descriptions of it last."""
    archive.add_text("README.md", readme(described))
    archive.add_text("LICENSE", described.licence.notice(described.title, described.people))
    archive.add_text("CITATION.cff", citation(described))
    archive.add_text("study.yaml", inputs.study_text(described.study, places))
    archive.add_text(
        "manifest.json", json.dumps(described.manifest, indent=2, sort_keys=True, ensure_ascii=False) + "\n"
    )
    archive.add_text("open.ipynb", notebook(described))
    for name in sorted(files):
        archive.add_file(name, files[name])
    if result.is_dir():
        for name in sorted(tree(result)):
            archive.add_file(f"{result.name}/{name}", result / name)
    else:
        archive.add_file(result.name, result)
        if archive.digests[result.name] != described.manifest["result"]["sha256"]:
            raise HeliosweepError(f"{result}: was changed while it was packed")
    archive.add_text(METADATA, crate(described, archive.digests, archive.sizes))
    archive.add_text("SHA256SUMS", archive.sums)
