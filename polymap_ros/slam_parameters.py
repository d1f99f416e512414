"""The parameters of poses that are estimated with the walls."""

from dataclasses import dataclass

from polymap_ros.errors import ParameterError
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
    map_origin: str = parameter(
        'odom', 'odom: the map frame is the odometry\'s at the first used ping; first_ping: its origin is the base '
        'there, so that coordinates stay small where the odometry\'s are large, such as UTM; needs slam.map_frame',
        choices=('odom', 'first_ping'))
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

    def check(self) -> None:
        if self.map_origin == 'odom':
            return
        if not self.map_frame:
            raise ParameterError('slam.map_origin', f'{self.map_origin!r} is another frame than the odometry\'s, and '
                                 'needs a name: set slam.map_frame')
        if self.mode == 'localization':
            raise ParameterError('slam.map_origin', f'{self.map_origin!r} is for maps that begin; with slam.mode '
                                 "'localization' the map is given, and its frame with it")
