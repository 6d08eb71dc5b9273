"""Small studies with some of their blocks replaced, and what is computed of a study."""

import copy
from collections.abc import Mapping
from typing import Any

from heliosweep import api


def study(base: Mapping[str, Any], **blocks: Any) -> Any:
    """A study with some blocks replaced; None removes one."""
    content = {**copy.deepcopy(dict(base)), **blocks}
    return api.load({key: value for key, value in content.items() if value is not None})


def computed(study: Any) -> Any:
    """The whole result of a study."""
    return api.build(study).compute()
