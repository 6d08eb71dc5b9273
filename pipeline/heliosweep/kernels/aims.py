"""Choices of aim points under limits of the flux: the dual function, and moves of single heliostats.

Images are a CSR matrix as a tuple: first entry of each row, cells, flux. The image of heliostat i with aim a is row
a * N + i. A choice is the number of the aim of each heliostat, -1 for a stowed one.
"""

import math

import numpy as np

from heliosweep.kernels.compiled import inline, kernel

#: Minimum share of an aim whose image counts.
_SHARE = 1e-9
#: Part of an overload below which a cell is not above its limit.
_EXCESS = 1e-12


@kernel
def smooth_dual(start, stop, power, images, price, width, load, share):
    """Return the sum of the smoothed maxima of the net power of heliostats start..stop.

    Writes the share of each aim of these heliostats, and adds the flux of the shares to `load`.
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
    """Return the power less the price of the flux, of each aim and heliostat."""
    first, cells, flux = images
    net = power.copy().reshape(-1)
    for row in range(power.size):
        for k in range(first[row], first[row + 1]):
            net[row] -= flux[k] * price[cells[k]]
    return net.reshape(power.shape)


@kernel
def brightest(first, cells, flux, limit):
    """Return the maximum flux of each image over the limit of its cell."""
    found = np.zeros(first.size - 1)
    for row in range(found.size):
        for k in range(first[row], first[row + 1]):
            found[row] = max(found[row], flux[k] / limit[cells[k]])
    return found


@inline
def _add(load, images, row, factor):
    """Add an image, times a factor, to the flux of the cells."""
    first, cells, flux = images
    for k in range(first[row], first[row + 1]):
        load[cells[k]] += factor * flux[k]


@inline
def _overload(load, limit, images, row):
    """Return the part of the limits that an image adds to the flux above the limits, summed over its cells."""
    first, cells, flux = images
    total = 0.0
    for k in range(first[row], first[row + 1]):
        room = 1.0 - load[cells[k]] / limit[cells[k]]
        part = flux[k] / limit[cells[k]]
        total += max(part - room, 0.0) - max(-room, 0.0)
    return total


@kernel
def round_shares(order, net, images, limit, share, load, choice):
    """Choose the aim of one heliostat after the other by net power and overload; those to come count by shares.

    `net` has the unit of the penalty: 1 for an overload of one cell by its limit. `load` is the flux of the shares, and
    becomes the flux of the choice.
    """
    aims, count = net.shape
    for i in order:
        for a in range(aims):
            if share[a, i] > _SHARE:
                _add(load, images, a * count + i, -share[a, i])
        best, choice[i] = 0.0, -1
        for a in range(aims):
            value = net[a, i]
            if value > best:
                value -= _overload(load, limit, images, a * count + i)
            if value > best:
                best, choice[i] = value, a
        if choice[i] >= 0:
            _add(load, images, choice[i] * count + i, 1.0)


@kernel
def relieve(power, images, limit, load, choice, part):
    """Move or stow heliostats until no cell is above its limit, at the least loss for the overload relieved.

    A round tries heliostats from the least loss on, and ends when `part` of the overload is gone.
    """
    count = power.shape[1]
    ratio, move = np.empty(count), np.empty(count, np.int64)
    while True:
        whole = 0.0
        for c in range(limit.size):
            over = load[c] / limit[c] - 1.0
            whole += over if over > _EXCESS else 0.0
        if whole == 0.0:
            return
        for i in range(count):
            ratio[i], move[i] = _cheapest(i, power, images, limit, load, choice)
        left = whole
        for i in np.argsort(ratio):
            if ratio[i] == np.inf or left < (1.0 - part) * whole:
                break
            now, then = _cheapest(i, power, images, limit, load, choice)
            if now > 2.0 * ratio[i] + 1e-300 and left < whole:
                continue
            row = choice[i] * count + i
            _add(load, images, row, -1.0)
            left -= _overload(load, limit, images, row)
            choice[i] = then
            if then >= 0:
                left += _overload(load, limit, images, then * count + i)
                _add(load, images, then * count + i, 1.0)


@inline
def _cheapest(i, power, images, limit, load, choice):
    """Return the least loss for the overload relieved by another aim of a heliostat, and this aim, -1 to stow."""
    aims, count = power.shape
    best, then = np.inf, -1
    if choice[i] < 0:
        return best, then
    mine, now = choice[i] * count + i, power[choice[i], i]
    _add(load, images, mine, -1.0)
    relief = _overload(load, limit, images, mine)
    if relief > 0.0:
        best = now / relief
        for a in range(aims):
            if a != choice[i]:
                left = relief - _overload(load, limit, images, a * count + i)
                if left > 0.0 and max(now - power[a, i], 0.0) < best * left:
                    best, then = max(now - power[a, i], 0.0) / left, a
    _add(load, images, mine, 1.0)
    return best, then


@kernel
def improve(power, images, limit, load, choice):
    """Move single heliostats to aims of more power whose cells have room, the largest gains first, until none gains."""
    aims, count = power.shape
    gain, moved = np.empty(count), True
    while moved:
        moved = False
        for i in range(count):
            gain[i] = power[:, i].max() - (power[choice[i], i] if choice[i] >= 0 else 0.0)
        for i in np.argsort(-gain):
            now = power[choice[i], i] if choice[i] >= 0 else 0.0
            if gain[i] <= _EXCESS * power[:, i].max():
                break
            if choice[i] >= 0:
                _add(load, images, choice[i] * count + i, -1.0)
            for a in range(aims):
                if power[a, i] > now and _fits(load, limit, images, a * count + i):
                    now, choice[i], moved = power[a, i], a, True
            if choice[i] >= 0:
                _add(load, images, choice[i] * count + i, 1.0)


@kernel
def exchange(power, images, limit, load, choice):
    """Move heliostats to aims of more power while one other heliostat moves or is stowed, until no pair gains."""
    aims, count = power.shape
    moved = True
    while moved:
        moved = False
        for i in range(count):
            now = power[choice[i], i] if choice[i] >= 0 else 0.0
            best, mine, other, then = _EXCESS * power[:, i].max(), -1, -1, -1
            if choice[i] >= 0:
                _add(load, images, choice[i] * count + i, -1.0)
            for j in range(count):
                if j == i or choice[j] < 0:
                    continue
                _add(load, images, choice[j] * count + j, -1.0)
                for a in range(aims):
                    gain = power[a, i] - now - power[choice[j], j]
                    if power[a, i] <= now or not _fits(load, limit, images, a * count + i):
                        continue
                    _add(load, images, a * count + i, 1.0)
                    if gain > best:
                        best, mine, other, then = gain, a, j, -1
                    for b in range(aims):
                        if gain + power[b, j] > best and _fits(load, limit, images, b * count + j):
                            best, mine, other, then = gain + power[b, j], a, j, b
                    _add(load, images, a * count + i, -1.0)
                _add(load, images, choice[j] * count + j, 1.0)
            if mine >= 0:
                _add(load, images, choice[other] * count + other, -1.0)
                choice[i], choice[other], moved = mine, then, True
                if then >= 0:
                    _add(load, images, then * count + other, 1.0)
            if choice[i] >= 0:
                _add(load, images, choice[i] * count + i, 1.0)


@inline
def _fits(load, limit, images, row):
    """Return True if no cell of an image is above its limit with the image."""
    first, cells, flux = images
    room = True
    for k in range(first[row], first[row + 1]):
        room = room and load[cells[k]] + flux[k] <= limit[cells[k]] * (1.0 + _EXCESS)
    return room
