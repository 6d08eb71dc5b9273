"""Global attributes of a result: CF-1.11 and ACDD-1.3, and nothing that differs from run to run."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

from heliosweep import __version__
from heliosweep.config.study import Study


def global_attributes(study: Study, title: str, references: Sequence[str]) -> dict[str, str]:
    """What the file says of itself.

    Parameters
    ----------
    study : Study
        The study that was run.
    title : str
        What its family computes, in one line.
    references : sequence of str
        Sources of the family's models.

    Returns
    -------
    dict of str to str
        No clock time, host, user or path; those are in the manifest.
    """
    attributes: dict[str, Any] = {
        "Conventions": "CF-1.11, ACDD-1.3",
        "title": study.title or title,
        "summary": study.description or title,
        "keywords": "concentrating solar power, heliostat, solar tracking, optical efficiency",
        "source": f"heliosweep {__version__}, family {study.family}",
        "history": f"computed by heliosweep {__version__} from study {study.study_id}",
        "references": "; ".join([*references, *study.references]),
        "naming_authority": "heliosweep",
        "id": study.study_id,
        "study_id": study.study_id,
        "study": json.dumps(study.canonical(), sort_keys=True, ensure_ascii=False),
    }
    return {
        name: " ".join(str(value).split()) if name == "summary" else str(value) for name, value in attributes.items()
    }
