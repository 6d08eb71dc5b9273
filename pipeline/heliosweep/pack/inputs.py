"""The study of an archive: with the files that it names beside it, and nothing of the machine that ran it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import PurePath
from typing import Any

import yaml

from heliosweep.config.fields import Parameter
from heliosweep.config.identity import _Dumper, plain
from heliosweep.config.names import FileName
from heliosweep.config.study import Study
from heliosweep.config.sweep import Sweep
from heliosweep.errors import HeliosweepError

#: Folder of the archive that holds what the study names.
FOLDER = "inputs"

#: What not every system can have in the name of a file, or reads as something else.
_UNSAFE = re.compile(r'[\x00-\x1f\x7f<>:"/\\|?*]|[. ]$|^\.{1,2}$|^(?i:con|prn|aux|nul|com[0-9]|lpt[0-9])(\..*)?$')
#: What of a manifest says nothing of who ran the study, and where.
_KEPT = ("finished", "identity", "parts", "plan", "remarks", "result", "seconds", "study_id")
_ENVIRONMENT = ("commit", "packages", "python")


def placed(study: Study) -> dict[str, str]:
    """Where each file that a study names stands in its archive.

    Parameters
    ----------
    study : Study
        The study.

    Returns
    -------
    dict of str to str
        Name in the study: name in the archive. The last part stays as it is, for results have it as a label.

    Raises
    ------
    HeliosweepError
        A file is missing, or has a name that not every system can have.
    """
    places: dict[str, str] = {}
    taken: dict[str, str] = {}
    for key, names in study.files().items():
        for name in names:
            if not study.resolve(name).is_file():
                raise HeliosweepError(
                    f"{key}: there is no such file: {study.resolve(name)}; an archive needs all inputs"
                )
            places[name] = _place(name, taken, key)
    return places


def _place(given: str, taken: dict[str, str], key: str) -> str:
    """A free place below the folder of inputs; the same one for the same name."""
    name = PurePath(given).name
    if _UNSAFE.search(name) or not name.isprintable():
        raise HeliosweepError(
            f"{key}: {name!r} is no name that every system can have; rename the file and run the study again"
        )
    number = 1
    while True:
        place = f"{FOLDER}/{name}" if number == 1 else f"{FOLDER}/{number}/{name}"
        if taken.setdefault(place.casefold(), given) == given:
            return place
        number += 1


def study_text(study: Study, places: Mapping[str, str]) -> str:
    """The study file of an archive: all defaults written out, inputs beside it, without how it was executed."""

    def rewrite(parameter: Parameter | None, value: Any) -> Any:
        if not isinstance(parameter, FileName):
            return value
        return [places[name] for name in value.values()] if isinstance(value, Sweep) else places[value]

    content = plain(study.model_copy(update={"execution": None}), rewrite)
    content = {key: entry for key, entry in content.items() if entry not in ("", [], {})}
    text = yaml.dump(content, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=100)
    return f"# Run it where it stands: heliosweep run study.yaml --output again\n{text}"


def cleaned(manifest: Mapping[str, Any]) -> dict[str, Any]:
    """A manifest without the command, paths and machine of the run."""
    kept = {key: manifest[key] for key in _KEPT if key in manifest}
    environment = manifest.get("environment", {})
    return kept | {
        "study_file": "study.yaml",
        "environment": {key: environment[key] for key in _ENVIRONMENT if key in environment},
    }
