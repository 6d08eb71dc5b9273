"""Licences of data sets: names, addresses and the notice that goes with the data."""

from __future__ import annotations

from dataclasses import dataclass

from heliosweep.config.citable import OWN

#: Of a data set whose study and user name none.
DEFAULT = "CC-BY-4.0"

_CC = "https://creativecommons.org"
_KNOWN = {
    "CC-BY-4.0": ("Creative Commons Attribution 4.0 International", f"{_CC}/licenses/by/4.0/"),
    "CC-BY-SA-4.0": ("Creative Commons Attribution-ShareAlike 4.0 International", f"{_CC}/licenses/by-sa/4.0/"),
    "CC-BY-NC-4.0": ("Creative Commons Attribution-NonCommercial 4.0 International", f"{_CC}/licenses/by-nc/4.0/"),
    "CC0-1.0": ("Creative Commons CC0 1.0 Universal (public domain dedication)", f"{_CC}/publicdomain/zero/1.0/"),
    "ODbL-1.0": ("Open Database License 1.0", "https://opendatacommons.org/licenses/odbl/1-0/"),
    "ODC-By-1.0": ("Open Data Commons Attribution License 1.0", "https://opendatacommons.org/licenses/by/1-0/"),
    "PDDL-1.0": ("Open Data Commons Public Domain Dedication 1.0", "https://opendatacommons.org/licenses/pddl/1-0/"),
}
_MEANS = {
    "CC-BY-4.0": (
        "You may share and adapt the data for any purpose, also commercially, if you give appropriate credit, link to "
        "the licence and say what you changed."
    ),
    "CC0-1.0": "To the extent possible under law, the creators have waived all rights to the data.",
}


@dataclass(frozen=True)
class Licence:
    """The licence of a data set.

    Parameters
    ----------
    text : str
        An SPDX identifier, or ``LicenseRef-NAME``.
    """

    text: str

    @property
    def spdx(self) -> str | None:
        """SPDX identifier; None for a licence of one's own."""
        return None if self.text.startswith(OWN) else self.text

    @property
    def name(self) -> str:
        """Name, for readers."""
        return _KNOWN[self.text][0] if self.text in _KNOWN else self.text

    @property
    def url(self) -> str | None:
        """Where its full text stands; None for a licence of one's own."""
        if self.text in _KNOWN:
            return _KNOWN[self.text][1]
        return f"https://spdx.org/licenses/{self.spdx}.html" if self.spdx else None

    def notice(self, title: str, people: str) -> str:
        """The file that goes with the data."""
        if self.url is None:
            return f"{title}\n{people}\n\nThe creators name the terms.\n\nSPDX-License-Identifier: {self.text}\n"
        legal = f"{self.url}legalcode" if self.text.startswith("CC") and self.text in _KNOWN else self.url
        parts = [
            f"{title}\n{people}",
            f"This data set is licensed under: {self.name} ({self.spdx}).",
            _MEANS.get(self.text, ""),
            f"Full text of the licence: {legal}",
            f"SPDX-License-Identifier: {self.spdx}",
        ]
        return "\n\n".join(part for part in parts if part) + "\n"
