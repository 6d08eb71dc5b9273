"""Write tables of study keys into the reference pages (``make reference``), and define the directive `study-example`.

The pages contain the tables as text, which can be read without building the site. A test fails if the tables differ
from the schema.
"""

from __future__ import annotations

import re
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from heliosweep.config.study import Key, Study, keys_of
from heliosweep.families.family import families

#: Pages that contain tables of keys.
PAGES = sorted((Path(__file__).parents[1] / "reference").glob("*.md"))

_MARKED = re.compile(
    r"(<!-- keys of (\w+), level (\d): ([\w ]+); written by `make reference` -->).*?(<!-- end of the keys -->)",
    re.DOTALL,
)


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("<", "&lt;").replace("\n", " ")


def _meaning(key: Key) -> str:
    """Return the description of a key, followed by its names and their meanings (if any)."""
    where = f" ({key.only})" if key.only else ""
    listed = "; ".join(f"`{name}`: {meaning}" for name, meaning in key.options)
    return _cell(f"{key.meaning}: {listed}{where}" if listed else f"{key.meaning}{where}")


def table(study: type[Study], keys: list[Key]) -> str:
    """Return a Markdown table of the keys, with an anchor for each key."""
    family = study.family_name()
    lines = ["| key | meaning | value | default | swept |", "|---|---|---|---|---|"]
    for key in keys:
        anchor = re.sub(r"\W|_", "-", f"{family}-{key.name}".replace("[]", "-each")).lower()
        default = key.default or ("**required**" if key.required else "")
        value = _cell(key.value) + (f" **{key.unit}**" if key.unit and key.unit != "B" else "")
        swept = ("instants" if key.sampled else "yes") if key.swept else ""
        cells = [f'<a id="{anchor}"></a>`{key.name}`', _meaning(key), value, default, swept]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def sections(family: str, names: str, level: int = 2) -> str:
    """Return a table of the top-level keys without a block, and a table for each block.

    `names` contains the top-level keys to include, or, after the word ``without``, the keys to omit.
    """
    study = families()[family].study_class()
    first, *rest = names.split() or [""]
    found: dict[str, list[Key]] = {}
    for key in keys_of(study):
        top = re.split(r"[.\[]", key.name)[0]
        if top not in rest if first == "without" else top in (first, *rest):
            found.setdefault(top, []).append(key)
    alone, mark = [keys[0] for keys in found.values() if len(keys) == 1], "#" * level
    texts = [f"{mark} At the top\n\n{table(study, alone)}"] if alone else []
    texts += [f"{mark} `{top}`\n\n{table(study, keys)}" for top, keys in found.items() if len(keys) > 1]
    return "\n\n".join(texts)


def filled(text: str) -> str:
    """Return a page with the tables requested by its marks.

    Each mark specifies the family, the heading level and the keys.
    """

    def written(found: re.Match[str]) -> str:
        begin, family, level, names, end = found.groups()
        return f"{begin}\n\n{sections(family, names, int(level))}\n\n{end}"

    return _MARKED.sub(written, text)


class StudyExample(SphinxDirective):
    """Directive `{study-example} FAMILY`, which shows the commented example study of a family."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the example study as a literal block."""
        text = families()[self.arguments[0]].example()
        return [nodes.literal_block(text, text, language="yaml")]


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("study-example", StudyExample)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


if __name__ == "__main__":
    for page in PAGES:
        page.write_text(filled(page.read_text(encoding="utf-8")), encoding="utf-8")
