"""RO-Crate metadata of an archive, written by the package `rocrate` (extra `crate`)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING

from heliosweep.errors import load_extra

if TYPE_CHECKING:
    from heliosweep.share.texts import Described

#: Name of the metadata file in the archive.
METADATA = "ro-crate-metadata.json"


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
    made.license, made.datePublished = described.licence_url or described.licence, words["finished"][:10]
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
