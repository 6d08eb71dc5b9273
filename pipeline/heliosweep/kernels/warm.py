"""Compilation of the kernels of fields by their smallest input, before work is shared among workers."""

import numpy as np


def warm_field(outlines: bool = False) -> None:
    """Make the kernels of heliostat fields ready, and optionally of outlines of shadows."""
    from heliosweep.kernels.field.efficiency import field_sums, sorted_field
    from heliosweep.kernels.outlines import mirror_outlines

    place, side = np.array([10.0, 30.0]), np.ones(2)
    sun = np.array([[0.0, 0.0, 1.0]])
    field = sorted_field(place, place, side, side, side, 50.0)
    field_sums(field, 0, sun, 0, 2)
    if outlines:
        mirror_outlines(place, place, side, side, side, 50.0, 0, sun[0], 0, 2, 1)


def warm_rays() -> None:
    """Make the tracer of a field with optics ready."""
    from heliosweep.kernels.rays import Errors, Facets, Scene, rectangle, trace
    from heliosweep.kernels.sunshapes import pillbox

    place, aim, none = np.array([[0.0, 100.0, 5.0]]), np.array([[0.0, 0.0, 60.0]]), np.zeros(1)
    errors, receiver = Errors(1e-3, 1e-3, 0.0), rectangle((0.0, 0.0, 60.0), 0.0, 0.0, 5.0, 5.0)
    scene = Scene(
        place,
        aim,
        np.ones((1, 2)),
        none,
        none,
        np.zeros((1, 2)),
        Facets(1, 1, 0.0),
        0,
        errors,
        pillbox(),
        receiver,
    )
    trace(scene, np.array([[0.0, -0.6, 0.8]]))
