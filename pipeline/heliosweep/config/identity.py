"""What makes two studies the same: their canonical content and the files they name."""

from __future__ import annotations

import datetime as dt
import hashlib
import json
from typing import TYPE_CHECKING, Any

import yaml

from heliosweep.config.block import Block
from heliosweep.config.source import scalar
from heliosweep.config.sweep import Sweep
from heliosweep.config.times import DateList, DateRange
from heliosweep.errors import StudyError

if TYPE_CHECKING:
    from heliosweep.config.study import Study


def plain(value: Any) -> Any:
    """Return a block or value as plain data that a study file may hold; keys that are not given are left out."""
    if isinstance(value, Block):
        given = ((name, getattr(value, name)) for name in type(value).model_fields)
        return {name: plain(entry) for name, entry in given if entry is not None}
    if isinstance(value, Sweep | DateList | DateRange):
        return plain(value.spec())
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    return value.isoformat() if isinstance(value, dt.date) else value


def study_id(study: Study) -> str:
    """Return twelve hexadecimal digits of the SHA-256 of the canonical study and of the files it names.

    Raises
    ------
    StudyError
        A named file cannot be read.
    """
    digests = {
        key: [_digest(study, key, name) for name in names]
        for key, names in study.files().items()
        if key.partition(".")[0] not in study.DOES_NOT_MATTER
    }
    content = {"study": study.canonical(), "files": digests}
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def resolved_yaml(study: Study) -> str:
    """Return the study with all defaults as the text of a study file that loads to the same study.

    File names stay as they were given, relative to the folder of the original study file.
    """
    content = {key: entry for key, entry in plain(study).items() if entry not in ("", [], {})}
    return yaml.dump(content, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=100)


def _digest(study: Study, key: str, name: str) -> str:
    try:
        with study.resolve(name).open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise StudyError(study.problem(key, f"cannot read {name}: {error.strerror}")) from None


class _Dumper(yaml.SafeDumper):
    """Writes what the strict reader accepts: no aliases, and quotes around text that looks like a number."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def _text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    style = None if isinstance(scalar(text), str) else '"'
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style)


_Dumper.add_representer(str, _text)
