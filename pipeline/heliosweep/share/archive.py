"""Archives of result folders for publication. The bytes of an archive depend only on its content."""

from __future__ import annotations

import hashlib
import io
import itertools
import json
import os
import re
import zipfile
from collections.abc import Mapping
from functools import partial
from pathlib import Path, PurePath
from typing import Any

import numpy as np
import yaml
from jinja2 import Environment, PackageLoader, StrictUndefined

from heliosweep.config import OWN, Invalid, Study, licence, yaml_text
from heliosweep.config.load import load
from heliosweep.errors import HeliosweepError, Problem, StudyError, log, printable
from heliosweep.families.family import study_classes
from heliosweep.files import user_path, written_whole
from heliosweep.report.page import FIGURES, PAGE, for_others
from heliosweep.store.folder import MANIFEST, RESULT, STUDIES, manifest_text, open_result, target_file, verify

#: Default creators of a study and licence identifier of a draft without a licence.
DEFAULT_CREATOR, DRAFT = "The authors of this data set", "LicenseRef-Draft"
#: Folder in the archive that contains the input files of the study.
FOLDER = "inputs"


def pack_result(
    folder: str | os.PathLike[str],
    output: str | os.PathLike[str] | None = None,
    *,
    license: str | None = None,
    draft: bool = False,
    force: bool = False,
) -> Path:
    """Pack a result folder into an archive that can be verified and rerun.

    Parameters
    ----------
    folder : path
        Complete and undamaged result folder.
    output : path, optional
        Path ``NAME.zip`` of the archive (default: name and location of the result folder).
    license : str, optional
        Licence of the data as an SPDX identifier or ``LicenseRef-NAME`` (default: licence of the study).
    draft : bool
        If True, write an unpublished draft, which may lack creators and a licence.
    force : bool
        If True, replace an existing archive.

    Returns
    -------
    pathlib.Path
        Path of the archive.

    Raises
    ------
    HeliosweepError
        If the result is incomplete or damaged, if an input of the study is missing or changed, or if the archive cannot
        be written.
    StudyError
        If the archive name is invalid, the licence is unknown, or the licence or the creators are missing.

    Examples
    --------
    >>> import heliosweep
    >>> heliosweep.pack_result("result", "result.zip", draft=True).name
    'result.zip'
    """
    place = user_path(folder)
    named = place if place.name not in ("", "..") else place.resolve()
    target = target_file(output or named.with_name(f"{named.name}.zip"), force, endings=(".zip",))
    words = _words(place, license, draft)
    study, manifest, places = words["study"], words["manifest"], placed(words["study"])
    plain = study.model_copy(update={"execution": None}).resolved(places.__getitem__)
    contents: dict[str, str | Path] = {
        "README.md": _text("README.md", words),
        "LICENSE": _text("LICENSE", words),
        "CITATION.cff": _citation(words),
        "study.yaml": f"# Run it in this folder: heliosweep run study.yaml --output again\n{yaml_text(plain)}",
        MANIFEST: manifest_text(manifest),
        "requirements.txt": _text("requirements.txt", words),
    }
    if (page := place / PAGE).is_file():
        contents[PAGE] = for_others(page.read_text(encoding="utf-8"), str(contents["study.yaml"]))
    contents |= dict(sorted((name, study.resolve(given)) for given, name in places.items()))
    drawn = (path for ending in ("png", "svg", "pdf") for path in (place / FIGURES).glob(f"*.{ending}"))
    contents |= {f"{FIGURES}/{path.name}": path for path in sorted(drawn) if path.is_file()}
    contents[RESULT] = place / RESULT
    top = f"{study.family}-{study.study_id}"
    with written_whole(target) as temporary, zipfile.ZipFile(temporary, "x", compresslevel=6) as zipped:
        digests = {name: _add(zipped, f"{top}/{name}", content) for name, content in contents.items()}
        if digests[RESULT] != manifest["result"]["sha256"]:
            raise HeliosweepError(f"{place / RESULT}: was changed while it was being packed")
        # lines in the format that sha256sum -c reads
        sums = "".join(f"{digest}  {name}\n" for name, digest in sorted(digests.items()))
        _add(zipped, f"{top}/SHA256SUMS", sums)
    return target


def _add(zipped: zipfile.ZipFile, name: str, content: str | Path) -> str:
    """Add text or a file to an archive and return the SHA-256 digest of the content. Files are copied in pieces."""
    text = content.encode() if isinstance(content, str) else b""
    info = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))  # the earliest date that ZIP supports
    info.create_system, info.external_attr = 3, 0o100644 << 16  # the same attributes on all systems
    info.compress_type = zipfile.ZIP_DEFLATED
    info.file_size = content.stat().st_size if isinstance(content, Path) else len(text)
    digest = hashlib.sha256()
    with (
        content.open("rb") if isinstance(content, Path) else io.BytesIO(text) as source,
        zipped.open(info, "w", force_zip64=info.file_size >= 2**31) as target,
    ):
        while piece := source.read(2**20):
            digest.update(piece)
            target.write(piece)
    return digest.hexdigest()


def _words(place: Path, license: str | None, draft: bool) -> dict[str, Any]:
    """Check a result folder and return the template values. Raises HeliosweepError or StudyError."""
    found = verify(place)
    if not (found.ok and found.finished):
        raise HeliosweepError(f"not packed; the result must be finished and undamaged:\n{found}")
    study = load(next(place / name for name in STUDIES if (place / name).exists()), study_classes())
    data_licence = _licence(place, study, license, draft)
    places, manifest = placed(study), json.loads((place / MANIFEST).read_text(encoding="utf-8"))
    if study.study_id != manifest["study_id"]:
        raise HeliosweepError(f"{place}: an input of the study was changed after the run")
    # these entries do not identify the user or the machine
    shared = ("commit", "lock", "packages", "python")
    environment = {key: value for key, value in manifest.get("environment", {}).items() if key in shared}
    if str(environment.get("commit", "")).endswith("-dirty"):
        log.warning("the result was computed by a version of heliosweep with uncommitted changes (-dirty)")
    wanted = ("finished", "identity", "plan", "remarks", "result", "seconds", "study_id")
    kept = {key: manifest[key] for key in wanted if key in manifest}
    dataset = study.dataset
    creators = dataset.creators if dataset else ()
    with open_result(place / RESULT) as stored:
        attributes = {name: np.asarray(value).tolist() for name, value in stored.attrs.items()}
        variables: dict[str, Any] = {
            "sizes": dict(stored.sizes),
            "coordinates": {name: one.variable for name, one in stored.coords.items()},
            "data": {name: one.variable for name, one in stored.data_vars.items()},
        }
    return variables | {
        "study": study,
        "manifest": {**kept, "study_file": "study.yaml", "environment": environment},
        "attributes": attributes,
        "inputs": dict(sorted((places[name], key) for key, names in study.files().items() for name in names)),
        "licence": data_licence,
        # the SPDX list does not contain custom licences
        "licence_url": None if data_licence.startswith(OWN) else f"https://spdx.org/licenses/{data_licence}.html",
        "title": str(attributes["title"]),
        "summary": str(attributes["summary"]),
        "keywords": str(attributes["keywords"]).split(", "),
        "result": RESULT,
        "study_id": manifest["study_id"],
        "finished": manifest["finished"],  # ISO 8601
        "software": str(attributes["source"]).removeprefix("heliosweep ").partition(",")[0],
        "commit": environment.get("commit"),
        "python": environment.get("python"),
        "versions": environment.get("lock") or environment.get("packages", {}),
        "is_draft": data_licence == DRAFT,
        "creators": creators,
        "people": "; ".join(creator.name for creator in creators) or DEFAULT_CREATOR,
        "doi": dataset.doi if dataset else None,  # identifier without the resolver address
        "version": dataset.version if dataset else None,
        "references": list(filter(None, str(attributes.get("references", "")).split("; "))),
    }


def _text(template: str, words: Mapping[str, Any]) -> str:
    options: dict[str, Any] = {"undefined": StrictUndefined, "trim_blocks": True, "keep_trailing_newline": True}
    texts = Environment(loader=PackageLoader("heliosweep.share"), **options)
    cell = partial(re.sub, r"([|\\])", r"\\\1")
    # times are decoded when the result is opened
    units: Any = lambda one: "date" if " since " in (unit := str(one.attrs.get("units", ""))) else unit  # noqa: E731
    # escapes Markdown, formulas and HTML
    escaped: Any = lambda text: re.sub(r"([\\`*\[\]<>|$~#&])", r"\\\1", printable(" ".join(str(text).split())))  # noqa: E731
    texts.filters |= {"cell": lambda text: cell(" ".join(text.split())), "prose": escaped, "units": units}
    texts.filters["printable"] = printable
    return texts.get_template(template).render(words)


def _citation(words: Mapping[str, Any]) -> str:
    authors = list[dict[str, Any]]()
    for one in words["creators"]:
        family, comma, given = one.name.partition(", ")
        names = {"family-names": family, "given-names": given} if comma else {"name": one.name}
        orcid = one.orcid and f"https://orcid.org/{one.orcid}"
        address = {"affiliation": one.affiliation if comma else None, "email": one.email, "orcid": orcid}
        authors.append(_without_empty({**names, **address}))
    software = {"type": "software", "title": "heliosweep", "version": words["software"],
                "authors": [{"name": "The heliosweep developers"}]}  # fmt: skip
    content = {
        "cff-version": "1.2.0",
        "message": "If you use this data set, please cite it as below.",
        "type": "dataset",
        "title": words["title"],
        "abstract": words["summary"],
        "authors": authors or [{"name": DEFAULT_CREATOR}],
        "date-released": words["finished"][:10],
        "keywords": words["keywords"],
        "doi": words["doi"],
        "version": words["version"],
        "identifiers": [{"type": "other", "value": words["study_id"], "description": "identifier of the study"}],
        "license": words["licence"] if words["licence_url"] else None,
        "references": [software],
    }
    return yaml.safe_dump(_without_empty(content), sort_keys=False, allow_unicode=True, width=120)


def _without_empty(entity: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in entity.items() if value}


def _licence(place: Path, study: Study, given: str | None, draft: bool) -> str:
    """Return the licence of the data.

    Raises StudyError if the licence is unknown, or if licence or creators are missing and `draft` is False.
    """
    try:
        given is None or licence(given)
    except Invalid as error:
        raise StudyError(Problem(f"{given!r} {error}", key="--license")) from error
    chosen = given if given is not None else (study.dataset.license if study.dataset else None)
    missing = [
        *([] if study.dataset and study.dataset.creators else ["'dataset.creators'"]),
        *([] if chosen else ["'dataset.license', or --license CC-BY-4.0"]),
    ]
    remedy = "add it to the study and run the study again, or use --draft"
    if missing and not draft:
        raise StudyError([Problem(f"a published archive needs {key}; {remedy}", file=str(place)) for key in missing])
    for key in missing:
        log.warning("this is a draft that must not be published: it needs %s", key)
    return chosen or DRAFT


def placed(study: Study) -> dict[str, str]:
    """Return the path of each input file in the archive. File names are kept because they label results.

    Raises
    ------
    HeliosweepError
        If an input file is missing, or if a file name is invalid on some operating systems.
    """
    places, taken = dict[str, str](), dict[str, str]()
    for key, names in study.files().items():
        for name in names:
            if not study.resolve(name).is_file():
                raise HeliosweepError(
                    f"{key}: file does not exist: {study.resolve(name)}; an archive needs all input files"
                )
            last = PurePath(name).name
            unsafe = r'[\x00-\x1f\x7f<>:"/\\|?*]|[. ]$|^\.{1,2}$|^(?i:con|prn|aux|nul|com[0-9]|lpt[0-9])(\..*)?$'
            if re.search(unsafe, last) or not last.isprintable():
                raise HeliosweepError(
                    f"{key}: {last!r} is not a valid file name on all operating systems: rename the file and run the "
                    "study again"
                )
            free = itertools.chain([f"{FOLDER}/{last}"], (f"{FOLDER}/{number}/{last}" for number in itertools.count(2)))
            places[name] = next(place for place in free if taken.setdefault(place.casefold(), name) == name)
    return places
