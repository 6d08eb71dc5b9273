"""The variables of a result."""

from heliosweep.grid.parameters import Parameters
from heliosweep.grid.regions import Variable
from heliosweep_fixed_panel.study import FixedPanelStudy

OVER_TIME = {"units": "1", "cell_methods": "time: mean (over the instants with the sun above the horizon)"}
ATTRIBUTES = {
    "mean_cosine": {
        "long_name": "mean cosine of the incidence on the panel",
        "comment": "0 while the sun is behind it",
    },
    "lit_fraction": {"long_name": "fraction of the daylight in which the sun is before the panel"},
}


def variables(study: FixedPanelStudy) -> dict[str, Variable]:
    """Means over the daylight at every point of the grid."""
    swept = tuple(Parameters(study).sizes)
    return {name: Variable(swept, attrs | OVER_TIME) for name, attrs in ATTRIBUTES.items()}
