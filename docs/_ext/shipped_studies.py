"""Directive `shipped-studies`: the studies of `studies/` with figures; quick studies are run."""

from __future__ import annotations

import math
import os
import shutil
from pathlib import Path
from typing import ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

ROOT = Path(__file__).parent.parent.parent
#: Results of studies that were run for this page alone, by study id.
CACHE = ROOT / "docs" / "_build" / "studies"
#: Studies that take longer than this by their plan are not run for it. [s]
QUICK = 3.0

log = logging.getLogger(__name__)


def figures_of(study_file: Path, run: bool) -> list[Path]:
    """Figures of a study's result: of outputs/, of an earlier build, or drawn now where `run` allows it."""
    import heliosweep

    study = heliosweep.load(study_file)
    name = f"{study_file.stem}-{study.study_id}"
    for folder in (ROOT / "outputs" / name, CACHE / name):
        found = sorted((folder / "figures").glob("*.png"))
        if found and (folder / "manifest.json").exists():
            return found
    if not run or (heliosweep.plan(study, timed=True).seconds or math.inf) > QUICK:
        return []
    log.info("running %s", study_file.name)
    heliosweep.run(study, CACHE / name)
    return sorted((CACHE / name / "figures").glob("*.png"))


class ShippedStudies(SphinxDirective):
    """`{shipped-studies}`; HELIOSWEEP_DOCS_STUDIES=no leaves out what would have to be run."""

    option_spec: ClassVar = {"figures": directives.positive_int}

    def run(self) -> list[nodes.Node]:
        """Return a section for each study."""
        import heliosweep

        run = os.environ.get("HELIOSWEEP_DOCS_STUDIES", "yes") != "no"
        images = Path(self.env.app.outdir) / "_images" / "gallery"
        lines: list[str] = []
        for study_file in sorted((ROOT / "studies").glob("*.yaml")):
            study = heliosweep.load(study_file)
            lines += [f"## {study_file.stem}", "", study.title, ""]
            if study.description:
                lines += [" ".join(study.description.split()), ""]
            shown = figures_of(study_file, run)[: self.options.get("figures", 2)]
            images.mkdir(parents=True, exist_ok=True)
            lines += ['<div class="gallery">'] if shown else []
            for figure in shown:
                name = f"{study_file.stem}-{figure.name}"
                shutil.copyfile(figure, images / name)
                words = figure.stem.replace("_", " ")
                lines.append(
                    f'<figure><img src="_images/gallery/{name}" loading="lazy" alt="{study.title}: {words}">'
                    f"<figcaption>{words}</figcaption></figure>"
                )
            lines += ["</div>", ""] if shown else []
        return self.parse_text_to_nodes("\n".join(lines), allow_section_headings=True)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("shipped-studies", ShippedStudies)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
