"""Directives `study-keys` and `study-example`: the keys of a family's study files, from its JSON Schema."""

from __future__ import annotations

import re
from typing import ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from heliosweep.config.keys import Key, is_sampled, keys_of
from heliosweep.config.study import Study, json_schema


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("<", "&lt;").replace("\n", " ")


def _meaning(key: Key) -> str:
    """The description; what each of several names means as a list."""
    where = f" ({key.only})" if key.only else ""
    listed = "; ".join(f"`{name}` {meaning}" for name, meaning in key.options)
    return _cell(f"{key.meaning}: {listed}{where}" if listed else f"{key.meaning}{where}")


def table(study: type[Study], keys: list[Key]) -> str:
    """Return the keys as a table in Markdown, each with an anchor."""
    family = study.family_name()
    lines = ["| key | what | value | default | swept |", "|---|---|---|---|---|"]
    for key in keys:
        anchor = f"{family}-{key.name}".replace("[]", "-each").replace(".", "-")
        default = key.default or ("**needed**" if key.required else "")
        value = _cell(key.value) + (f" **{key.unit}**" if key.unit and key.unit != "B" else "")
        swept = ("instants" if is_sampled(study, key) else "yes") if key.swept else ""
        cells = [f"[`{key.name}`]{{#{anchor}}}", _meaning(key), value, default, swept]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


class StudyKeys(SphinxDirective):
    """`{study-keys} FAMILY` with `:only:` or `:without:` top-level keys, and the `:level:` of headings."""

    required_arguments = 1
    option_spec: ClassVar = {
        "only": directives.unchanged,
        "without": directives.unchanged,
        "level": directives.positive_int,
    }

    def run(self) -> list[nodes.Node]:
        """Return a table for the keys at the top and one for each block."""
        from heliosweep.families.family import families

        study = families()[self.arguments[0]].study_class()
        only, without = self.options.get("only", "").split(), self.options.get("without", "").split()
        level = "#" * self.options.get("level", 2)
        found: dict[str, list[Key]] = {}
        for key in keys_of(json_schema(study)):
            top = re.split(r"[.\[]", key.name)[0]
            if top not in without and (not only or top in only):
                found.setdefault(top, []).append(key)
        alone = [keys[0] for keys in found.values() if len(keys) == 1]
        texts = [f"{level} At the top\n\n{table(study, alone)}"] if alone else []
        texts += [f"{level} `{top}`\n\n{table(study, keys)}" for top, keys in found.items() if len(keys) > 1]
        return self.parse_text_to_nodes("\n\n".join(texts), allow_section_headings=True)


class StudyExample(SphinxDirective):
    """`{study-example} FAMILY`: the commented study file to start from."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the file."""
        from heliosweep.families.family import families

        text = families()[self.arguments[0]].example()
        return [nodes.literal_block(text, text, language="yaml")]


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directives."""
    app.add_directive("study-keys", StudyKeys)
    app.add_directive("study-example", StudyExample)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
