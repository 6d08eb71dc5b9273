"""Bad studies, each with all that is said of it, from the text file beside this one."""

from pathlib import Path

_TEXT = Path(__file__).with_suffix(".txt").read_text(encoding="utf-8")


def _case(text: str) -> tuple[str, str, list[str]]:
    name, *lines = text.rstrip("\n").split("\n")
    said = [line.removeprefix("=> ") for line in lines if line.startswith("=> ")]
    return name, "\n".join(lines[: len(lines) - len(said)]).replace(r"\a", "\a"), said


#: Line that is replaced (or "file" for the whole text), what it becomes, what is said.
BAD_STUDIES = [_case(text) for text in _TEXT.split("\n@ ")[1:]]
