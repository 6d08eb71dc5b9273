"""Family `fixed_panel`: how squarely the sun meets a panel that does not move."""

from heliosweep.families.family import Family


class FixedPanel(Family):
    """The family; its parts are the modules beside this one."""

    name = "fixed_panel"
    title = "mean cosine of the incidence on a panel that does not move"
    references = ("Duffie and Beckman (2013), Solar Engineering of Thermal Processes, section 1.6",)


FAMILY = FixedPanel()
