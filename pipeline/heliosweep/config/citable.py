"""Values by which a data set can be cited and used: licences by SPDX identifier, and DOIs."""

from __future__ import annotations

import re
from typing import Any

from heliosweep.config.faults import Invalid, nearest
from heliosweep.config.names import Text

_CC = ("CC-BY", "CC-BY-SA", "CC-BY-NC", "CC-BY-ND", "CC-BY-NC-SA", "CC-BY-NC-ND")
_GNU = ("GPL-2.0", "GPL-3.0", "LGPL-2.1", "LGPL-3.0", "AGPL-3.0", "GFDL-1.3")
#: SPDX identifiers of the licences that data sets usually have.
LICENCES = (
    "CC0-1.0", *(f"{name}-{version}" for name in _CC for version in ("1.0", "2.0", "2.5", "3.0", "4.0")),
    "ODbL-1.0", "ODC-By-1.0", "PDDL-1.0", "CDLA-Permissive-1.0", "CDLA-Permissive-2.0", "CDLA-Sharing-1.0",
    "C-UDA-1.0", "O-UDA-1.0", "DL-DE-BY-2.0", "DL-DE-ZERO-2.0", "etalab-2.0", "NLOD-2.0", "OGL-Canada-2.0",
    "OGL-UK-3.0", "0BSD", "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "BSD-3-Clause-Clear", "BSL-1.0", "CECILL-2.1",
    "EUPL-1.1", "EUPL-1.2", "ISC", "MIT", "MIT-0", "MPL-2.0", "Unlicense", "Zlib",
    *(f"{name}-{which}" for name in _GNU for which in ("only", "or-later")),
)  # fmt: skip
#: Begins the name of a licence that SPDX does not list.
OWN = "LicenseRef-"

_OWN = r"LicenseRef-[A-Za-z0-9.-]+"
_DOI = r"(?:https?://(?:dx\.)?doi\.org/|doi:)?(10\.\d{4,9}(?:\.\d+)*/\S+)"


def licence(text: str) -> str:
    """Return the identifier of a licence as it was given. Raises Invalid."""
    if text in LICENCES or re.fullmatch(_OWN, text):
        return text
    if text.startswith(OWN):
        raise Invalid(f"{OWN}NAME has letters, digits, '.' and '-' in its name")
    meant = nearest(text.casefold(), by_fold := {name.casefold(): name for name in LICENCES})
    hint = f"; did you mean '{by_fold[meant]}'?" if meant else f"; use one as CC-BY-4.0 or CC0-1.0, or {OWN}NAME"
    raise Invalid(f"is no SPDX identifier of a usual licence{hint}")


class LicenceName(Text):
    """SPDX identifier of a licence, or ``LicenseRef-NAME``."""

    def read(self, raw: Any) -> str:
        """Return the identifier. Raises Invalid."""
        return licence(super().read(raw))

    def json_schema(self) -> dict[str, Any]:
        """Return the JSON Schema of an identifier."""
        return {"anyOf": [{"enum": list(LICENCES)}, {"type": "string", "pattern": f"^{_OWN}$"}]}


class Doi(Text):
    """DOI, bare or as an address of doi.org."""

    def read(self, raw: Any) -> str:
        """Return the bare DOI. Raises Invalid."""
        found = re.fullmatch(_DOI, super().read(raw).strip())
        if found is None:
            raise Invalid("must be a DOI, as 10.5281/zenodo.1234567")
        return found[1]

    def json_schema(self) -> dict[str, Any]:
        """Return the JSON Schema of a DOI."""
        return {"type": "string", "pattern": f"^\\s*{_DOI}\\s*$"}
