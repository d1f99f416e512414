"""What a run leaves behind: the files of interface.md, for the replay and for the node's save service."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polymap_ros.mapping.estimate import Caution, Estimate
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.mapping.plane import XY
from polymap_ros.parameters import Parameters
from polymap_ros.results import folder as names
from polymap_ros.results.arrays import beam_map_npz, state_npz
from polymap_ros.results.export import exported
from polymap_ros.results.map_files import map_yaml, pgm
from polymap_ros.results.occupancy import occupancy_of
from polymap_ros.results.picture import picture_png
from polymap_ros.results.polygon_json import encode, polygon_document


def write_results(
    stage: Path, mapper: PolygonMapper, estimate: Estimate, parameters: Parameters, *,
    cautions: Sequence[Caution] = (), truth: NDArray[np.float64] | None = None,
    plot: bool = False, save_map: bool = False, exports: Sequence[str] = (),
) -> None:
    """Write polygon.json and state.npz, map.pgm and map.yaml of a closed polygon, and what else is asked for.

    Parameters
    ----------
    stage : Path
        Of `polymap_ros.results.folder.result_folder`.
    mapper : PolygonMapper
        Holds the counts, the beamforming map and the path.
    estimate : Estimate
        In the odometry's frame.
    parameters : Parameters
        Those in force.
    cautions : sequence of Caution
        Warnings beside the estimate's own.
    truth : ndarray, shape (n, 2), optional
        Corners of the true polygon [m], for the picture.
    plot, save_map : bool
        Whether to write polygon.png and beam_map.npz.
    exports : sequence of str
        Formats of `polymap_ros.results.export` to write ``polygon.<format>`` in, where there is something to write.

    Raises
    ------
    ParameterError
        Where `map.resolution_m` makes a map beyond reason.
    OSError
        Where a file cannot be written.
    """
    document = polygon_document(
        estimate, mapper.frame_id, mapper.counts, parameters, cautions, mapper.plane or XY)
    (stage / names.POLYGON).write_bytes(encode(document))
    (stage / names.STATE).write_bytes(state_npz(mapper.state()))
    if estimate.status == 'closed' and estimate.polygon is not None:
        grid = occupancy_of(estimate.polygon.vertices, parameters)
        (stage / names.MAP_IMAGE).write_bytes(pgm(grid))
        (stage / names.MAP_YAML).write_bytes(map_yaml(grid, names.MAP_IMAGE))
    if plot:
        (stage / names.PICTURE).write_bytes(picture_png(mapper, estimate, truth))
    if save_map:
        (stage / names.BEAM_MAP).write_bytes(beam_map_npz(mapper.beam_map, mapper.start_pose))
    for kind in exports:
        if (content := exported(kind, estimate, mapper.frame_id, mapper.plane or XY)) is not None:
            (stage / f'polygon.{kind}').write_bytes(content)
