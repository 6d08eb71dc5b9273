"""Archive of result folders for publication; its bytes depend on its content only."""

from __future__ import annotations

import hashlib
import io
import itertools
import json
import logging
import os
import re
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from functools import cache, cached_property, partial
from pathlib import Path, PurePath
from typing import Any

import numpy as np
import xarray as xr
import yaml
from jinja2 import Environment, PackageLoader, StrictUndefined

from heliosweep.config.blocks import OWN
from heliosweep.config.blocks import licence as checked_licence
from heliosweep.config.faults import Invalid
from heliosweep.config.load import load
from heliosweep.config.study import Study, yaml_text
from heliosweep.errors import HeliosweepError, Problem, StudyError, load_extra, printable
from heliosweep.families.family import study_classes
from heliosweep.files import user_path, written_whole
from heliosweep.report.page import FIGURES, PAGE, for_others
from heliosweep.runs.verify import verify
from heliosweep.store.folder import MANIFEST, STUDIES, manifest_text, target_file
from heliosweep.store.read import open_result

#: Creators of a study that names none.
DEFAULT_CREATOR = "The authors of this data set"
#: Licence of a draft that has none.
DRAFT = "LicenseRef-Draft"


@dataclass(frozen=True)
class Described:
    """A data set with all that its texts contain.

    Parameters
    ----------
    study : Study
        The study.
    manifest : mapping
        Manifest of its result, without paths and machine.
    attributes : mapping
        Global attributes of the result.
    sizes : mapping of str to int
        Dimensions.
    coordinates, data : mapping of str to xarray.Variable
        Variables of the result.
    inputs : mapping of str to str
        Key of the study that names each input, by the name of the input in the archive.
    licence : str
        SPDX identifier, or ``LicenseRef-NAME``.
    place, file : pathlib.Path
        Result folder, and file of the result.
    """

    study: Study
    manifest: Mapping[str, Any]
    attributes: Mapping[str, Any]
    sizes: Mapping[str, int]
    coordinates: Mapping[str, xr.Variable]
    data: Mapping[str, xr.Variable]
    inputs: Mapping[str, str]
    licence: str
    place: Path
    file: Path

    @cached_property
    def words(self) -> dict[str, Any]:
        """Values that the texts use, by name."""
        attributes, manifest, dataset = self.attributes, self.manifest, self.study.dataset
        result, environment = str(manifest["result"]["file"]), manifest.get("environment", {})
        creators = dataset.creators if dataset else ()
        return {
            **{field.name: getattr(self, field.name) for field in fields(self)},
            # SPDX does not list licences of one's own.
            "licence_url": None if self.licence.startswith(OWN) else f"https://spdx.org/licenses/{self.licence}.html",
            "title": str(attributes["title"]),
            "summary": str(attributes["summary"]),
            "keywords": str(attributes["keywords"]).split(", "),
            "result": result,
            "study_id": str(manifest["study_id"]),
            "finished": str(manifest["finished"]),  # ISO 8601
            "software": str(attributes["source"]).removeprefix("heliosweep ").partition(",")[0],
            "commit": environment.get("commit"),
            "python": environment.get("python"),
            "versions": environment.get("lock") or environment.get("packages", {}),
            "is_draft": self.licence == DRAFT,
            "creators": creators,
            "people": "; ".join(creator.name for creator in creators) or DEFAULT_CREATOR,
            "doi": dataset.doi if dataset else None,  # without the address of its resolver
            "version": dataset.version if dataset else None,
            "references": list(filter(None, str(attributes.get("references", "")).split("; "))),
        }


@cache
def _templates() -> Environment:
    """Return the templates of the texts."""
    options: dict[str, Any] = {"undefined": StrictUndefined, "trim_blocks": True, "keep_trailing_newline": True}
    texts = Environment(loader=PackageLoader("heliosweep.share"), **options)
    cell = partial(re.sub, r"([|\\])", r"\\\1")
    # Times are decoded when the result is opened.
    units: Any = lambda one: "date" if " since " in (unit := str(one.attrs.get("units", ""))) else unit  # noqa: E731
    texts.filters |= {"cell": lambda text: cell(" ".join(text.split())), "prose": prose, "units": units}
    texts.filters["printable"] = printable
    return texts


def text_of(template: str, **words: Any) -> str:
    """Return README.md, LICENSE, requirements.txt, or COLLECTION.md of several results, from its template."""
    return _templates().get_template(template).render(words)


def prose(text: object) -> str:
    """Return text on one line of Markdown, with markup, formulas and HTML escaped."""
    return re.sub(r"([\\`*\[\]<>|$~#&])", r"\\\1", printable(" ".join(str(text).split())))


def citation(described: Described) -> str:
    """Return the text of CITATION.cff."""
    words, authors = described.words, list[dict[str, Any]]()
    for one in words["creators"]:
        family, comma, given = one.name.partition(", ")
        names = {"family-names": family, "given-names": given} if comma else {"name": one.name}
        address = {"affiliation": one.affiliation if comma else None, "email": one.email, "orcid": one.orcid_url}
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
        "license": described.licence if words["licence_url"] else None,
        "references": [software],
    }
    return yaml.safe_dump(_without_empty(content), sort_keys=False, allow_unicode=True, width=120)


def _without_empty(entity: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in entity.items() if value}


def crate(described: Described, digests: Mapping[str, str], sizes: Mapping[str, int]) -> str:
    """Return the text of ``ro-crate-metadata.json``: the files, their creators and the run.

    Parameters
    ----------
    described : Described
        Data set of the archive.
    digests, sizes : mapping of str to str, int
        SHA-256 and size of each file in the archive, by name. [bytes]

    Raises
    ------
    HeliosweepError
        If the package `rocrate` is not installed.
    """
    library = load_extra("rocrate.rocrate", "rocrate", "crate")
    from rocrate.model import ContextEntity, File, Person

    words = described.words
    made = library.ROCrate()
    made.name, made.description, made.keywords = words["title"], words["summary"], ", ".join(words["keywords"])
    made.license, made.datePublished = words["licence_url"] or described.licence, words["finished"][:10]
    made.creator = [
        made.add(Person(made, creator.orcid_url or f"#creator-{number}", {"name": creator.name}))
        for number, creator in enumerate(words["creators"], 1)
    ]
    files = {
        name: made.add(File(made, None, name, properties={"sha256": digest, "contentSize": str(sizes[name])}))
        for name, digest in digests.items()
    }
    program = {"@type": "SoftwareApplication", "name": "heliosweep", "version": words["software"]}
    run = made.add(ContextEntity(made, "#run", {"@type": "CreateAction", "endTime": words["finished"]}))
    run["instrument"] = made.add(ContextEntity(made, "#heliosweep", program))
    run["object"] = [files[name] for name in ("study.yaml", *described.inputs)]
    run["result"] = [entity for name, entity in files.items() if name.partition("/")[0] == words["result"]]
    return json.dumps(made.metadata.generate(), indent=2, ensure_ascii=False) + "\n"


log = logging.getLogger("heliosweep")

#: Folder of the archive with the input files of the study.
FOLDER = "inputs"

#: Parts of file names that some systems refuse.
_UNSAFE = re.compile(r'[\x00-\x1f\x7f<>:"/\\|?*]|[. ]$|^\.{1,2}$|^(?i:con|prn|aux|nul|com[0-9]|lpt[0-9])(\..*)?$')
#: Keys of a manifest without user and machine.
_KEPT = ("finished", "identity", "plan", "remarks", "result", "seconds", "study_id")
#: Date of every file in an archive: the earliest of the format.
_DATE = (1980, 1, 1, 0, 0, 0)


def pack_result(
    folder: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    output: str | os.PathLike[str] | None = None,
    *,
    license: str | None = None,
    draft: bool = False,
    ro_crate: bool = False,
    force: bool = False,
) -> Path:
    """Write result folders as one archive that can be verified and rerun.

    Parameters
    ----------
    folder : path, or sequence of paths
        Result folder, finished and whole; several become a collection, each in a folder of its own.
    output : path, optional
        The archive, ``NAME.zip``; default: name and place of the folder. Required for a collection.
    license : str, optional
        Licence of the data, an SPDX identifier or ``LicenseRef-NAME``; default: licence of the study.
    draft : bool
        Whether creators and licence may be missing, for an archive that is not published yet.
    ro_crate : bool
        Whether to add ``ro-crate-metadata.json`` (RO-Crate, needs the extra ``crate``).
    force : bool
        Whether to replace an existing archive.

    Returns
    -------
    pathlib.Path
        The archive. Its bytes depend on the result folders alone.

    Raises
    ------
    HeliosweepError
        If a result is unfinished or damaged, an input of a study is missing or changed, or the archive cannot be
        written.
    StudyError
        If the archive cannot have the name, the licence is unknown, or it or the creators are missing.

    Examples
    --------
    >>> import heliosweep
    >>> heliosweep.pack_result("result", "result.zip", draft=True).name
    'result.zip'
    """
    places = [user_path(one) for one in ([folder] if isinstance(folder, str | os.PathLike) else folder)]
    if not places or (len(places) > 1 and output is None):
        raise StudyError(Problem("name the archive of several results", key="--output"))
    named = places[0] if places[0].name not in ("", "..") else places[0].resolve()
    target = target_file(output or named.with_name(f"{named.name}.zip"), force, endings=(".zip",))
    results = [described(place, license, draft) for place in places]
    members = {f"{one.study.family}-{one.study.study_id}": one for one in results}
    if len(members) < len(results):
        raise StudyError(Problem("two of the folders hold results of the same study", file=str(target)))
    names = sorted(members)
    if len(names) == 1:
        with writing(target, names[0]) as archive:
            _add(archive, results[0], ro_crate)
        return target
    ids = hashlib.sha256("".join(names).encode()).hexdigest()[:12]
    with writing(target, f"heliosweep-collection-{ids}") as archive:
        for name in names:
            _add(archive.below(name), members[name], ro_crate)
        titles = {name: members[name].words["title"] for name in names}
        archive.add("README.md", text_of("COLLECTION.md", members=titles))
    return target


def described(place: Path, license: str | None, draft: bool) -> Described:
    """Check a result folder and describe it. Raises HeliosweepError, StudyError."""
    found = verify(place)
    if not (found.ok and found.finished):
        raise HeliosweepError(f"not packed; the result must be finished and undamaged:\n{found}")
    study = load(next(place / name for name in STUDIES if (place / name).exists()), study_classes())
    licence = _licence(place, study, license, draft)
    places, manifest = placed(study), json.loads((place / MANIFEST).read_text(encoding="utf-8"))
    if study.study_id != manifest["study_id"]:
        raise HeliosweepError(f"{place}: an input of the study was changed since it ran")
    environment = manifest.get("environment", {})
    if str(environment.get("commit", "")).endswith("-dirty"):
        log.warning("the result was computed by a heliosweep with changes that its commit does not hold (-dirty)")
    kept = {key: manifest[key] for key in _KEPT if key in manifest} | {
        "study_file": "study.yaml",
        # Without user and machine.
        "environment": {
            key: environment[key] for key in ("commit", "lock", "packages", "python") if key in environment
        },
    }
    with open_result(place / manifest["result"]["file"]) as stored:
        return Described(
            study,
            kept,
            {name: np.asarray(value).tolist() for name, value in stored.attrs.items()},
            {str(dim): size for dim, size in stored.sizes.items()},
            {str(name): one.variable for name, one in stored.coords.items()},
            {str(name): one.variable for name, one in stored.data_vars.items()},
            dict(sorted((places[name], key) for key, names in study.files().items() for name in names)),
            licence,
            place,
            place / manifest["result"]["file"],
        )


def _add(archive: Archive, one: Described, ro_crate: bool) -> None:
    """Write a result in a fixed order. Raises HeliosweepError if it was changed during packing."""
    result, places = one.file, placed(one.study)
    study = one.study.model_copy(update={"execution": None}).resolved(places.__getitem__)
    archive.add("README.md", text_of("README.md", **one.words))
    archive.add("LICENSE", text_of("LICENSE", **one.words))
    archive.add("CITATION.cff", citation(one))
    archive.add("study.yaml", f"# Run it in this folder: heliosweep run study.yaml --output again\n{yaml_text(study)}")
    archive.add(MANIFEST, manifest_text(one.manifest))
    archive.add("requirements.txt", text_of("requirements.txt", **one.words))
    if (page := one.place / PAGE).is_file():
        archive.add(PAGE, for_others(page.read_text(encoding="utf-8")))
    drawn = (path for ending in ("png", "svg", "pdf") for path in (one.place / FIGURES).glob(f"*.{ending}"))
    figures = {f"{FIGURES}/{path.name}": path for path in sorted(drawn) if path.is_file()}
    inputs = {name: one.study.resolve(given) for given, name in places.items()}
    files = {**dict(sorted(inputs.items())), **figures, result.name: result}
    for name, path in files.items():
        archive.add(name, path)
    if archive.digests[result.name] != one.manifest["result"]["sha256"]:
        raise HeliosweepError(f"{result}: was changed while it was packed")
    if ro_crate:
        archive.add("ro-crate-metadata.json", crate(one, archive.digests, archive.sizes))
    archive.add("SHA256SUMS", archive.sums)


def _licence(place: Path, study: Study, given: str | None, draft: bool) -> str:
    """Return the licence. Raises StudyError if it is unknown, or it or the creators are missing in no draft."""
    try:
        given is None or checked_licence(given)
    except Invalid as error:
        raise StudyError(Problem(f"{given!r} {error}", key="--license")) from error
    licence = given if given is not None else (study.dataset.license if study.dataset else None)
    missing = [
        *([] if study.dataset and study.dataset.creators else ["'dataset.creators'"]),
        *([] if licence else ["'dataset.license', or --license CC-BY-4.0"]),
    ]
    remedy = "add it to the study and run it again (nothing is recomputed), or pack a --draft"
    if missing and not draft:
        raise StudyError([Problem(f"an archive to publish needs {key}; {remedy}", file=str(place)) for key in missing])
    for key in missing:
        log.warning("a draft, not to be published: it needs %s", key)
    return licence or DRAFT


def placed(study: Study) -> dict[str, str]:
    """Return the name in the archive of each input file; the last part is kept because results use it as a label.

    Raises
    ------
    HeliosweepError
        If a file is missing, or some systems refuse its name.
    """
    places, taken = dict[str, str](), dict[str, str]()
    for key, names in study.files().items():
        for name in names:
            if not study.resolve(name).is_file():
                raise HeliosweepError(
                    f"{key}: there is no such file: {study.resolve(name)}; an archive needs all inputs"
                )
            places[name] = _place(name, taken, key)
    return places


def _place(given: str, taken: dict[str, str], key: str) -> str:
    """Return a free place below the folder of inputs; the same one for the same name."""
    name = PurePath(given).name
    if _UNSAFE.search(name) or not name.isprintable():
        raise HeliosweepError(
            f"{key}: {name!r} is no name that every system can have; rename the file and run the study again"
        )
    names = itertools.chain([f"{FOLDER}/{name}"], (f"{FOLDER}/{number}/{name}" for number in itertools.count(2)))
    return next(place for place in names if taken.setdefault(place.casefold(), given) == given)


class Archive:
    """A zip file under construction, all of it below one folder.

    Attributes
    ----------
    digests : dict of str to str
        SHA-256 of each file written so far, by its name below the folder.
    sizes : dict of str to int
        Their sizes. [bytes]
    """

    def __init__(self, zipped: zipfile.ZipFile, top: str) -> None:
        self._zipped, self._top = zipped, top
        self.digests: dict[str, str] = {}
        self.sizes: dict[str, int] = {}

    def below(self, name: str) -> Archive:
        """Return a folder of the archive with separate digests."""
        return Archive(self._zipped, f"{self._top}/{name}")

    def add(self, name: str, content: str | Path) -> None:
        """Write a text, or copy a file piece by piece."""
        text = content.encode() if isinstance(content, str) else b""
        info = zipfile.ZipInfo(f"{self._top}/{name}", _DATE)
        info.create_system, info.external_attr = 3, 0o100644 << 16  # the same on every system
        info.compress_type = zipfile.ZIP_DEFLATED
        info.file_size = content.stat().st_size if isinstance(content, Path) else len(text)
        digest, written = hashlib.sha256(), 0
        with (
            content.open("rb") if isinstance(content, Path) else io.BytesIO(text) as source,
            self._zipped.open(info, "w", force_zip64=info.file_size >= 2**31) as target,
        ):
            while piece := source.read(2**20):
                digest.update(piece)
                written += target.write(piece)
        self.digests[name], self.sizes[name] = digest.hexdigest(), written

    @property
    def sums(self) -> str:
        """Digests in the format of ``sha256sum -c``."""
        return "".join(f"{digest}  {name}\n" for name, digest in sorted(self.digests.items()))


@contextmanager
def writing(path: Path, top: str) -> Iterator[Archive]:
    """Write an archive, which gets its name when it is complete. Raises HeliosweepError."""
    with written_whole(path) as temporary, zipfile.ZipFile(temporary, "x", compresslevel=6) as zipped:
        yield Archive(zipped, top)
