"""What a run leaves behind, for the replay and for the node's save service."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from polymap_ros.cautions import Caution
from polymap_ros.geometry.plane import XY
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.parameters import Parameters
from polymap_ros.results import folder as names
from polymap_ros.results.arrays import state_npz
from polymap_ros.results.folder import Entry
from polymap_ros.results.map_files import map_yaml, pgm
from polymap_ros.results.occupancy import cell_size, occupancy_of
from polymap_ros.results.polygon_json import encode, polygon_document
from polymap_ros.results.tum import tum
from polymap_ros.solvers.estimate import Estimate


def answer(
    mapper: PolygonMapper, estimate: Estimate, parameters: Parameters, cautions: Sequence[Caution] = (),
    recording: str | None = None,
) -> tuple[Entry, ...]:
    """Return the files that hold what was computed: polygon.json, state.npz and trajectory.tum.

    Parameters
    ----------
    mapper : PolygonMapper
        Holds the counts and the state.
    estimate : Estimate
        In the map frame.
    parameters : Parameters
        Those in force.
    cautions : sequence of Caution
        Warnings beside the estimate's own.
    recording : str, optional
        Name of the recording that was replayed.
    """
    path = mapper.path()

    def polygon() -> bytes:
        return encode(polygon_document(
            estimate, mapper.map_frame, mapper.counts, parameters, cautions, mapper.plane or XY, recording,
            int(path.lost.sum()), mapper.map_to_odom))

    return (Entry.of(names.POLYGON, polygon), Entry.of(names.STATE, lambda: state_npz(mapper.state())),
            Entry.of(names.TRAJECTORY, lambda: tum(path.stamps_ns[~path.lost], path.poses[~path.lost])))


def map_files(estimate: Estimate, parameters: Parameters) -> Iterator[Entry]:
    """Give map.pgm and map.yaml of a closed polygon that cells of the size asked for can hold."""
    closed = estimate.polygon if estimate.status == 'closed' else None
    if closed is None or cell_size(closed.vertices, parameters).resolution_m is None:
        return

    def write(folder: Path) -> None:
        grid = occupancy_of(estimate, parameters)
        if grid is not None:
            (folder / names.MAP_IMAGE).write_bytes(pgm(grid))
            (folder / names.MAP_YAML).write_bytes(map_yaml(grid, names.MAP_IMAGE))

    yield Entry((names.MAP_IMAGE, names.MAP_YAML), write)


def map_cautions(estimate: Estimate, parameters: Parameters) -> list[Caution]:
    """Say where a closed polygon has no map, or one of cells larger than usual."""
    if estimate.status != 'closed' or estimate.polygon is None:
        return []
    caution = cell_size(estimate.polygon.vertices, parameters).caution
    return [caution] if caution else []
