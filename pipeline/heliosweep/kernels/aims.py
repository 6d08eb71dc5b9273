"""Choose aim points under flux limits with the smoothed dual function, or for one heliostat at a time.

The flux images form a CSR matrix, stored as a tuple of three arrays: the first entry of each row, the cells, and the
flux. Row a * N + i is the image of heliostat i for aim a. A choice contains the index of the aim chosen for each
heliostat, or -1 if the heliostat is stowed.
"""

import math

import numpy as np

from heliosweep.kernels.compiled import inline, kernel

#: Images of aims with at most this share are neglected.
_SHARE = 1e-9
#: Maximum tolerated excess of the flux in a cell above its limit, relative to the limit.
EXCESS = 1e-12


@inline
def _add(load, images, row, factor):
    first, cells, flux = images
    for k in range(first[row], first[row + 1]):
        load[cells[k]] += factor * flux[k]


@kernel
def smooth_dual(start, stop, power, images, price, width, load, share):
    """Return the smoothed maximum of the net power over all aims, summed over heliostats start..stop.

    The function also writes the share of each aim, and adds the flux of each image times its share to `load`.
    """
    first, cells, flux = images
    aims, count = power.shape
    total = 0.0
    for i in range(start, stop):
        top = 0.0
        for a in range(aims):
            net = power[a, i]
            for k in range(first[a * count + i], first[a * count + i + 1]):
                net -= flux[k] * price[cells[k]]
            share[a, i], top = net, max(top, net)
        whole = math.exp(-top / width)
        for a in range(aims):
            share[a, i] = math.exp((share[a, i] - top) / width)
            whole += share[a, i]
        total += top + width * math.log(whole)
        for a in range(aims):
            share[a, i] /= whole
            if share[a, i] > _SHARE:
                _add(load, images, a * count + i, share[a, i])
    return total


@kernel
def net_powers(power, images, price):
    """Return the power of each image minus the price of its flux, for each aim and heliostat."""
    first, cells, flux = images
    net = power.copy().reshape(-1)
    for row in range(power.size):
        for k in range(first[row], first[row + 1]):
            net[row] -= flux[k] * price[cells[k]]
    return net.reshape(power.shape)


@kernel
def brightest(images, limit):
    """Return the maximum ratio of flux to limit over the cells of each image."""
    first, cells, flux = images
    found = np.zeros(first.size - 1)
    for row in range(found.size):
        for k in range(first[row], first[row + 1]):
            found[row] = max(found[row], flux[k] / limit[cells[k]])
    return found


@kernel
def choose(order, power, images, limit, penalty, share, load, choice):
    """Choose, for each heliostat in turn, the aim that maximises the power minus `penalty` times the added overload.

    An overload is the flux in a cell above its limit, divided by the limit. On entry, `load` contains the flux for the
    shares in `share`. On return, `load` contains the flux of the chosen aims, and each chosen aim has a share of 1.
    Returns True if the aim of any heliostat has changed.
    """
    first, cells, flux = images
    aims, count = power.shape
    moved = False
    for i in order:
        for a in range(aims):
            if share[a, i] > _SHARE:
                _add(load, images, a * count + i, -share[a, i])
            share[a, i] = 0.0
        best, then = 0.0, -1
        for a in range(aims):
            if power[a, i] > best:
                overload = 0.0
                for k in range(first[a * count + i], first[a * count + i + 1]):
                    before = load[cells[k]] / limit[cells[k]] - 1.0
                    overload += max(before + flux[k] / limit[cells[k]], EXCESS) - max(before, EXCESS)
                value = power[a, i] - (penalty * overload if overload > 0.0 else 0.0)
                if value > best:
                    best, then = value, a
        if then >= 0:
            share[then, i] = 1.0
            _add(load, images, then * count + i, 1.0)
        moved = moved or then != choice[i]
        choice[i] = then
    return moved
