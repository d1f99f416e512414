"""Start shapes of outlines that are not convex: cheapest closed walks round the path, along lines that were heard.

In the arrangement of oriented lines a walk goes forwards along a line, inside on its left, and may turn onto another
one where they cross. Each turn costs a price, each metre without a heard foot more, each foot that is nearer than the
ping's first echo, and each crossing of the robot's way. Of every line by which the room may be left on the way from one
ping, Dijkstra's algorithm gives the cheapest walk that comes back to it.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from polymap_ros.geometry.outline import corners_of, crossings, normals_of
from polymap_ros.jit import kernel
from polymap_ros.solvers.evidence.data import EchoData
from polymap_ros.solvers.evidence.rings import HEARD, RingFeet

_STEP_M = 0.01
"""Length along a line for which costs are told apart, where the pulse is no longer: less than any foot's reach."""

_FOOT_REACH, _LEG = 0.6, 3.0
"""Typical ways from ping to ping that a heard foot speaks for to each side, and beyond which a way is not known."""

_NEARER = 10.0
"""Nats for a foot that is nearer to a ping than its first echo."""

_CROSSED = 60.0
"""Nats for an edge across the way from one ping to the next."""

_SHARPEST = 0.17
"""Sine of the angle between two lines from which they make a corner: 10 degrees."""

_OUTWARDS = 0.2
"""Sine of the angle at which a line is met, at least, by which the room is left."""

_RAYS = 4
"""Directions in which the room is left from one ping."""


class Costs(NamedTuple):
    """What a walk costs: `price` for a turn, `unheard` for a metre without a heard foot [nats].

    `later` is the share of that where only later echoes than the first were heard.
    """

    price: float
    unheard: float
    later: float


COSTS = Costs(17.0, 30.0, 0.0), Costs(4.0, 80.0, 0.5)
"""By the first, few edges are found, by the second those that explain first echoes: narrow arms, and dents."""


class Arrangement(NamedTuple):
    """Lines (m, 2), where along each of them the others cross it (m, m) [m], and what it costs to follow them.

    `along` is nan where lines do not cross. `cost` (m, k) is what following a line costs from `first_m` on, in steps of
    `step_m`.
    """

    lines: NDArray[np.float64]
    along: NDArray[np.float64]
    cost: NDArray[np.float64]
    first_m: NDArray[np.float64]
    step_m: float

    def upto(self, line: int, place_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what it costs to follow a line up to places along it."""
        grid = self.first_m[line] + self.step_m * np.arange(self.cost.shape[1])
        return np.asarray(np.interp(place_m, grid, self.cost[line]))


def closed_walks(data: EchoData, lines: NDArray[np.float64], feet: RingFeet, costs: Costs) -> list[NDArray[np.int64]]:
    """Return rings, as numbers of the lines (m, 2), round the path, cheapest first."""
    arrangement = _arranged(data, lines, feet, costs)
    network = _Network(arrangement, costs.price)
    rings: dict[tuple[int, ...], float] = {}
    for ray in 2.0 * np.pi * np.arange(_RAYS) / _RAYS:
        for cost, ring in network.walks(data.positions[0], np.array((np.cos(ray), np.sin(ray)))):
            least = int(np.argmin(ring))
            key = (*ring[least:], *ring[:least])
            rings[key] = min(rings.get(key, np.inf), cost)
    found = [np.array(ring, np.int64) for ring in sorted(rings, key=lambda ring: rings[ring])]
    return [ring for ring in found if corners_of(lines[ring], data.shortest_m)[0]]


def _arranged(data: EchoData, lines: NDArray[np.float64], feet: RingFeet, costs: Costs) -> Arrangement:
    table, positions = normals_of(lines), data.positions
    c, s = table[:, 1], table[:, 2]
    along = crossings(lines, _SHARPEST)
    places = np.outer(c, positions[:, 1]) - np.outer(s, positions[:, 0])
    low, high = places.min(axis=1) - data.range_max_m / 2.0, places.max(axis=1) + data.range_max_m / 2.0
    along[(along < low[:, None]) | (along > high[:, None])] = np.nan
    along[np.isnan(along.T)] = np.nan
    step_m = max(_STEP_M, 0.5 * data.pulse.width_m)
    cost = np.zeros((len(lines), int(np.ceil((high - low).max() / step_m)) + 1))
    way = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    spacing_m = float(np.median(way)) if len(way) else step_m
    for line in range(len(lines)):
        _fill_cost(table[line], low[line], step_m, feet, spacing_m, costs, cost[line])
    return Arrangement(lines, along, np.cumsum(cost, axis=1), low, step_m)


@kernel
def _fill_cost(
    line: NDArray[np.float64], low: float, step: float, feet: RingFeet, spacing: float, costs: Costs,
    cost: NDArray[np.float64],
) -> None:
    """Fill the cost of each step along a line."""
    r, c, s = line
    positions, reach = feet.positions, _FOOT_REACH * spacing
    left = np.ones(len(cost))  # of the price of what is not heard
    for i in range(len(positions)):
        away, foot = r - positions[i, 0] * c - positions[i, 1] * s, positions[i, 1] * c - positions[i, 0] * s
        k = int((foot - low) / step)
        if 0.0 < away < feet.first[i] - feet.near and 0 <= k < len(cost):
            cost[k] += _NEARER
        k = int(away / feet.cell + 0.5)
        if away > 0.0 and k < feet.evidence.shape[1] and feet.evidence[i, k] > HEARD:
            share = 0.0 if abs(away - feet.first[i]) < feet.near else costs.later
            for j in range(max(int((foot - reach - low) / step), 0),
                           min(int((foot + reach - low) / step) + 1, len(cost))):
                left[j] = min(left[j], share)
        if i + 1 < len(positions):
            dx, dy = positions[i + 1, 0] - positions[i, 0], positions[i + 1, 1] - positions[i, 1]
            later = away - dx * c - dy * s
            if away * later < 0.0 and dx * dx + dy * dy < (_LEG * spacing) ** 2:
                k = int((foot + away / (away - later) * (dy * c - dx * s) - low) / step)
                if 0 <= k < len(cost):
                    cost[k] += _CROSSED
    cost += costs.unheard * step * left


class _Network:
    """Crossings along lines as nodes; from each a walk goes on along its line, or turns onto the other one."""

    def __init__(self, arrangement: Arrangement, price: float) -> None:
        self._arrangement = arrangement
        along = arrangement.along
        count = np.sum(~np.isnan(along), axis=1)
        order = np.argsort(along, axis=1, kind='stable')  # nan last
        self._first = np.concatenate(([0], np.cumsum(count)))
        node = np.full(along.shape, -1)
        for line, others in enumerate(order):
            node[line, others[:count[line]]] = self._first[line] + np.arange(count[line])
        rows, columns = np.nonzero(node >= 0)
        sorting = np.argsort(node[rows, columns], kind='stable')
        rows, columns = rows[sorting], columns[sorting]
        self._line, self._along = rows, along[rows, columns]
        upto = np.concatenate([arrangement.upto(line, self._along[self._first[line]:self._first[line + 1]])
                               for line in range(len(along))])
        nodes = np.arange(len(rows))
        onwards = nodes[:-1][rows[:-1] == rows[1:]]
        # int32: older scipy's dijkstra refuses graphs with other indices.
        self._tails = np.concatenate((onwards, nodes)).astype(np.int32)
        self._heads = np.concatenate((onwards + 1, node[columns, rows])).astype(np.int32)
        # The least cost keeps an arc that costs nothing in the graph.
        self._costs = np.concatenate((upto[onwards + 1] - upto[onwards], np.full(len(nodes), price))) + 1e-9
        self._upto, self._onwards = upto, len(onwards)

    def walks(self, place: NDArray[np.float64], direction: NDArray[np.float64]) -> Iterator[tuple[float, list[int]]]:
        """Give cost and ring of the cheapest walk by each line that is met on the way from a place in a direction.

        Such a walk meets that way nowhere before.
        """
        table = normals_of(self._arrangement.lines)
        outwards = table[:, 1:] @ direction
        distance = np.full(len(table), np.inf)
        np.divide(table[:, 0] - table[:, 1:] @ place, outwards, out=distance, where=np.abs(outwards) > 1e-3)
        met = np.flatnonzero(np.isfinite(distance) & (distance > 0.0))
        free = np.ones(len(self._tails), np.bool_)
        for line in met[np.argsort(distance[met], kind='stable')]:
            x, y = place + distance[line] * direction
            at = float(y * table[line, 1] - x * table[line, 2])
            nodes = np.arange(self._first[line], self._first[line + 1])
            split = int(np.searchsorted(self._along[nodes], at, side='right'))
            if 0 < split < len(nodes):  # the arc that crosses the way
                free[np.searchsorted(self._tails[:self._onwards], nodes[split - 1])] = False
                if outwards[line] > _OUTWARDS:
                    yield from self._walk(int(line), at, nodes[:split], int(nodes[split]), free)

    def _walk(
        self, line: int, at: float, before: NDArray[np.int64], after: int, free: NDArray[np.bool_]
    ) -> Iterator[tuple[float, list[int]]]:
        size, here = len(self._line), float(self._arrangement.upto(line, np.array(at)))
        graph = csr_array((self._costs[free], (self._tails[free], self._heads[free])), shape=(size, size))
        reached, previous = dijkstra(graph, indices=after, return_predecessors=True)
        total = reached[before] + (here - self._upto[before]) + (self._upto[after] - here)
        if not np.isfinite(total.min()):
            return
        ring: list[int] = []
        node = int(before[int(np.argmin(total))])
        while node >= 0:
            if not ring or ring[-1] != self._line[node]:
                ring.append(int(self._line[node]))
            node = int(previous[node])
        if ring[0] == ring[-1]:
            ring.pop()
        if len(ring) > 2:
            yield float(total.min()), ring[::-1]
