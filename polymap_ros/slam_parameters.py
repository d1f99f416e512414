"""The parameters of poses that are estimated with the walls."""

from dataclasses import dataclass

from polymap_ros.specification import Group, parameter


@dataclass(frozen=True)
class SlamParameters(Group):
    """Poses that are estimated with the walls (`evidence` only)."""

    PREFIX = 'slam.'
    mode: str = parameter(
        'auto', 'auto: poses are estimated with the walls where the reported ones do not explain the echoes; off: the '
        'odometry is taken as exact; localization: the outline of output.load_path is kept, only the pose is estimated',
        choices=('auto', 'off', 'localization'))
    map_frame: str = parameter(
        '', 'name of the map frame, which is the odometry\'s at the first used ping and stays where it is; set, the '
        'outputs are in it and TF from it to the odometry\'s frame is broadcast')
    publish_tf: bool = parameter(True, 'false: no TF, since somebody else gives it')
    tf_period_s: float = parameter(0.05, 'time from one broadcast of TF to the next', unit='s', minimum=1e-3,
                                   maximum=1e3)
    tf_tolerance_s: float = parameter(0.1, 'how far ahead of now TF is stamped', unit='s', minimum=0.0, maximum=1e3)
    noise_m_sqrt_m: float = parameter(
        0.015, 'assumed random walk of the distance that the odometry reports', unit='m per root m', above=0.0,
        maximum=10.0)
    noise_deg_sqrt_m: float = parameter(
        1.5, 'assumed random walk of the heading that it reports', unit='deg per root m', above=0.0, maximum=360.0)
    noise_turn: float = parameter(
        0.05, 'share of a turn by which it is assumed to misjudge it', minimum=0.0, maximum=1.0)
