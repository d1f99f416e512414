"""result.mcap: the odometry and everything the node would have published, for Foxglove and RViz."""

from pathlib import Path

from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.mapping.plane import XY
from polymap_ros.messages.markers import drawing_of, marker_array_message
from polymap_ros.messages.outputs import beam_map_message, occupancy_grid_message, polygon_message
from polymap_ros.parameters import NODE_NAME, Parameters
from polymap_ros.recordings.reading import Recording
from polymap_ros.recordings.writing import RecordingWriter, make
from polymap_ros.results.occupancy import occupancy_of

POLYGON, MARKERS, BEAM_MAP, MAP = (f'/{NODE_NAME}/{name}' for name in ('polygon', 'markers', 'beam_map', 'map'))


def write_outcome(
    path: Path, recording: Recording, odom_topic: str, mapper: PolygonMapper, parameters: Parameters,
    start_s: float | None = None, end_s: float | None = None,
) -> None:
    """Write a bare .mcap file with the mapper's last answer and the recording's odometry.

    The answer is logged at the start, so that whoever plays the file sees it all along.

    Parameters
    ----------
    path : Path
        Must not exist.
    recording : Recording
        Open; its odometry is copied.
    odom_topic : str
        As recorded.
    mapper : PolygonMapper
        Solved.
    parameters : Parameters
        For the occupancy grid.
    start_s, end_s : float, optional
        The interval that was replayed [s].
    """
    with RecordingWriter(path, latched=(POLYGON, MARKERS, BEAM_MAP, MAP)) as writer:
        log_ns = recording.start_ns + round(1e9 * (start_s or 0.0))
        estimate, frame_id, plane = mapper.estimate, mapper.frame_id, mapper.plane or XY
        stamp_ns = estimate.stamp_ns if estimate is not None else log_ns
        if estimate is not None and estimate.status == 'closed' and estimate.polygon is not None:
            corners = estimate.polygon.vertices
            grid = occupancy_of(corners, parameters)
            writer.write(POLYGON, polygon_message(make, stamp_ns, frame_id, corners, plane), log_ns)
            writer.write(MAP, occupancy_grid_message(
                make, stamp_ns, frame_id, grid.cells, grid.resolution_m, grid.origin, plane), log_ns)
        writer.write(MARKERS, marker_array_message(make, drawing_of(mapper)), log_ns)
        writer.write(BEAM_MAP, beam_map_message(make, stamp_ns, f'{NODE_NAME}/start', mapper.beam_map.values), log_ns)
        for entry in recording.messages([odom_topic], start_s, end_s):
            writer.write(entry.topic, entry.message, entry.log_ns)
