"""Room for the paths of one ping: what is known of each."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polymap_ros.jit import kernel

CAPACITY = 512
"""Paths kept per ping: an octagon of order 5 has about 110."""


class Paths(NamedTuple):
    """Room for the paths of one ping.

    Attributes
    ----------
    half : ndarray, shape (capacity,)
        Half the path's length [m].
    weight : ndarray, shape (capacity,)
        What the ends of its walls leave of it, in (0, 1], times the coefficients of floor and ceiling.
    hits : ndarray, shape (capacity,), int64
        Number of reflections from walls.
    bounces : ndarray, shape (capacity,), int64
        Number of reflections from floor and ceiling.
    walls : ndarray, shape (capacity, order), int64
        Walls in the order they are hit; -1 beyond `hits`.
    slopes : ndarray, shape (capacity, order, 2)
        Derivatives of `half` by r and theta of each of these walls; by r it is the cosine of incidence, below 0 at the
        back of an inner wall.
    moves : ndarray, shape (capacity, 4)
        Derivatives of `half` by x and y of the emitter and of the receiver.
    images : ndarray, shape (capacity, 3)
        Image of the emitter [m], and the share of the path that no wall in the way takes.
    """

    half: NDArray[np.float64]
    weight: NDArray[np.float64]
    hits: NDArray[np.int64]
    bounces: NDArray[np.int64]
    walls: NDArray[np.int64]
    slopes: NDArray[np.float64]
    moves: NDArray[np.float64]
    images: NDArray[np.float64]


@kernel
def room_for_paths(order: int) -> Paths:
    """Room for paths of up to so many reflections."""
    return Paths(np.empty(CAPACITY), np.empty(CAPACITY), np.empty(CAPACITY, np.int64), np.empty(CAPACITY, np.int64),
                 np.empty((CAPACITY, order), np.int64), np.empty((CAPACITY, order, 2)), np.empty((CAPACITY, 4)),
                 np.empty((CAPACITY, 3)))
