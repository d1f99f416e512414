"""The one registry of warnings: what each code means, and what an operator does about it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple


class Kind(NamedTuple):
    """What a code stands for.

    Parameters
    ----------
    about : str
        The stage that it speaks of: ``recording``, ``path``, ``echoes``, ``answer``, ``device``,
        ``calibration``, ``map`` or ``node``.
    meaning : str
        What it means, in general.
    remedy : str
        What to do about it, unless the warning at hand knows better.
    """

    about: str
    meaning: str
    remedy: str


CAUTIONS = {
    'recording_damaged': Kind(
        'recording', 'parts of the recording cannot be read; what is intact is used',
        'copy the recording again from where it was made, and judge the map by what is left'),
    'recording_incomplete': Kind(
        'recording', 'the recording holds another number of messages than it announces',
        'copy it again, once the recorder has ended'),
    'recording_inconsistent': Kind(
        'recording', 'the names of files or metadata.yaml disagree with what the files hold, which is read',
        'check that these are the files that you mean; ros2 bag reindex writes metadata.yaml anew'),
    'odometry_dropped': Kind(
        'recording', 'odometry messages were left out, and why',
        "look at the odometry's stamps, frame_id and quaternions in the recording"),
    'wrong_type': Kind(
        'recording', 'messages on the echo topic are no A-scans, such as the scans of a lidar',
        'name the topic of the A-scans with topics.echo, and what they are with echo.type'),
    'pings_dropped': Kind(
        'recording', 'many pings could not be used, and why most of them were dropped',
        'mend that where the echoes are recorded, or name others with topics.echo'),
    'too_few_pings': Kind(
        'path', 'fewer pings could be used than a polygon takes',
        'go on pinging while the robot drives along all walls; some tens of pings are a good start'),
    'pings_far_apart': Kind(
        'path', 'by the odometry pings are further from each other than what one hears allows to compare',
        'check that the odometry is in metres; where it is, ping more often on the way, or raise grid.range_max_m'),
    'straight_path': Kind(
        'path', 'the path does not tell walls from their mirror images',
        'drive a turn, so that the path leaves that line by a tenth of its length or more'),
    'path_outside': Kind(
        'path', 'pings lie outside the polygon (`paper` and `rectangle`)',
        'do not use this polygon: solve by solver.method evidence, or raise solver.iterations'),
    'no_free_area': Kind(
        'echoes', 'no ping has an echo that stands out of its noise',
        'check that the sensor is on and coupled, that topics.echo is its topic, that pulse.frequency_hz is what it '
        'emits, and that echo.blanking_m and grid.range_max_m leave room for the walls'),
    'common_unknown': Kind(
        'echoes', 'what all pings have in common is not known yet (`front_end.common_pings`)',
        'drive on, in more than one direction, or set front_end.common_pings lower'),
    'dc_offset': Kind(
        'echoes', 'the samples lie about another value than 0, or magnitudes above one, which is taken out',
        'set front_end.remove_dc: true where the device counts without a sign or from a floor, and echo.kind: envelope '
        'where samples are magnitudes'),
    'baseline_drift': Kind(
        'echoes', 'the baseline moves within the pings by more than the echoes are strong',
        'set front_end.band_low_hz to about a third of pulse.frequency_hz, which takes ramps, recoveries and hum out'),
    'echo_band': Kind(
        'echoes', 'the samples have their energy at other frequencies than the pulse',
        'check the sample period in the messages, or echo.sample_period_s, and pulse.frequency_hz; what is louder than '
        'the echoes, such as hum, goes with front_end.band_low_hz and band_high_hz'),
    'noise_line': Kind(
        'echoes', 'narrow-band lines that last as long as the pings, of motors or switching supplies, are taken out',
        "look for the machine, and keep the sensor's cable away from it"),
    'impulses': Kind(
        'echoes', 'samples that stand out above the band of the pulse, as of relays, are interpolated',
        "look for what switches, and keep the sensor's cable away from it"),
    'not_closed': Kind(
        'answer', 'walls were not heard that would close the polygon; those that are certain are in `walls`',
        'drive along the walls that are missing, nearer to them, and through places that they face squarely'),
    'mirror_image': Kind(
        'answer', 'another polygon, the mirror image about the path, explains the echoes as well; both are in '
                  '`alternatives`',
        'drive a turn; or take the candidate whose walls are on the side where you see them'),
    'unheard_corner': Kind(
        'answer', 'no echo has been near a corner: a wall that cuts it off would be missed',
        'drive towards that corner, or look whether it is there'),
    'weak_edge': Kind(
        'answer', 'an edge whose `likelihood` is below 0.9',
        'drive past that edge, through places that it faces squarely, before you rely on it'),
    'curved_edge': Kind(
        'answer', 'a wall is not straight: the edge touches it in its middle, where it is as exact as any other',
        'nothing, where you know it to be curved; else look whether it is, or a corner lies on it'),
    'rounded_corners': Kind(
        'answer', 'edges end before they meet; the corners of the polygon are where they would',
        'nothing, where the corners are round; else look for what stands in them'),
    'unexplained': Kind(
        'answer', 'echoes are left that the polygon does not explain: a dent, a seam, a second mode, a wrong medium',
        'look for what else reflects, or a corner that points inwards; if there is neither, let polymap_replay '
        '--calibrate check the medium'),
    'not_convex': Kind(
        'answer', 'an outline that is not convex explains more of the echoes than a convex one, but not enough of them',
        'drive into every arm and along every wall, with pings closer together, and raise solver.max_edges where the '
        'outline has more edges; solver.outline: convex looks for convex ones only'),
    'odometry_drift': Kind(
        'answer', 'the echoes agree only where the poses are corrected; polygon and path are the corrected ones',
        'use the corrected path; where the odometry errs by more than it should, check wheels, stamps and medium'),
    'odometry_scale': Kind(
        'answer', 'ways are longer by the odometry, or shorter, than by the echoes, so that the speed of the waves or '
        'the odometry is wrong; lengths are by the echoes',
        'measure one edge: where it is as in the polygon, set odometry.scale, else the medium'),
    'slip': Kind(
        'answer', 'the robot moved in a way that its odometry did not see',
        'look for what made it slip there, where the map has to be exact'),
    'lost': Kind(
        'answer', 'pings fit no place between the walls; they are not in the map',
        'look for what stood beside the robot then, or was moved since; where output.load_path is set, check that its '
        'map is of this place'),
    'incoherent': Kind(
        'answer', 'the echoes agree in power, not in phase: medium, time zero or positions are off',
        'check medium, pulse, time zero and odometry: polymap_replay --calibrate, --fit-pulse, --fit-time-zero and '
        '--fit-odometry tell'),
    'dispersion': Kind(
        'answer', 'magnitudes in a plate: walls may be some millimetres off, or wrong',
        'record the signal itself (echo.kind: rf) where millimetres matter'),
    'wrong_medium': Kind(
        'device', 'another medium explains the echoes, the one given does not', 'replay with --calibrate'),
    'wrong_odometry': Kind(
        'device', 'another scale or yaw drift of the odometry explains the echoes, the one given does not',
        'replay with --fit-odometry'),
    'calibrated': Kind(
        'calibration', 'the map is made with what was found from the echoes, not with what was given',
        'give calibration.yaml as --params-file from now on'),
    'not_calibrated': Kind(
        'calibration', 'nothing better was found from the echoes; the map is made with what was given',
        'record again with turns, and with walls near by on all sides'),
    'pulse_adapted': Kind(
        'calibration', 'the map is made with a pulse that was fitted to the echoes, not with the one that was given',
        'from now on: polymap_replay --fit-pulse, which writes pulse.npy; then -p pulse.kind:=file -p '
        'pulse.path:=pulse.npy'),
    'medium_uneven': Kind(
        'calibration', 'the map is made with a medium whose waves got faster meanwhile, or are faster in one '
        'direction, as was found from the echoes',
        'nothing, where the plate got warmer or colder or was rolled; else check medium.* and the odometry'),
    'direct_wave': Kind(
        'calibration', 'what the wave from emitter to receiver tells of the time zero',
        'rely on what the echoes tell of echo.t0_s'),
    'map_coarse': Kind(
        'map', 'the cells of the occupancy map are larger than `grid.range_step_m`, so that the place fits in',
        'set their size with map.resolution_m, if another one suits you better'),
    'map_too_large': Kind(
        'map', 'the place has too many cells of the size asked for: there is no occupancy map; the answer is complete',
        'set map.resolution_m to 0, which chooses a size that fits'),
    'coarse_polygon': Kind(
        'node', 'the coordinates are too large for the 32 bits that a point of ~/polygon has',
        'take the corners from ~/markers or ~/save, which are exact, or set slam.map_origin: first_ping, '
        'with slam.map_frame, so that the map begins where the robot does'),
    'no_answer': Kind(
        'node', 'the map was saved before anything was solved', 'save again after solver.period_s'),
}
"""By code, the earliest stage first. A code that is not here cannot be made."""


_OF_DOUBT = ('unexplained', 'incoherent', 'weak_edge')
_OF_FAULTY_SAMPLES = ('baseline_drift', 'echo_band')


@dataclass(frozen=True)
class Caution:
    """Something the user must know about an answer.

    Parameters
    ----------
    code : str
        One of `CAUTIONS`; it stays the same from version to version.
    finding : str
        What was found, with its figures: a clause without a full stop.
    remedy : str, optional
        The next thing to do; by default that of the code.

    Raises
    ------
    ValueError
        For a code that is not registered.
    """

    code: str
    finding: str
    remedy: str = ''

    def __post_init__(self) -> None:
        if self.code not in CAUTIONS:
            raise ValueError(f'{self.code}: no registered caution; known: {", ".join(CAUTIONS)}')
        if not self.remedy:
            object.__setattr__(self, 'remedy', CAUTIONS[self.code].remedy)

    @property
    def text(self) -> str:
        """Return what was found and what to do, in one line."""
        return f'{self.finding}; {self.remedy}'


def causes(cautions: Sequence[Caution]) -> list[Caution]:
    """Pick what most likely keeps a polygon from closing.

    No stage is blamed for the fault of an earlier one: with too few pings what became of the others counts, samples
    whose baseline or energy is not where the pulse has it come before what was made of them, and a medium or an
    odometry that was found to be wrong comes before what the solver made of it.

    Parameters
    ----------
    cautions : sequence of Caution
        Of the answer, its own first.
    """
    if not cautions:
        return []
    if dropped := [each for each in cautions if each.code == 'pings_dropped']:
        rest = [each for each in cautions if each.code != 'too_few_pings' and each not in dropped]
        return [*dropped, *(each for each in causes(rest) if CAUTIONS[each.code].about not in ('recording', 'path'))]
    if cautions[0].code == 'too_few_pings':
        return [cautions[0], *_about('recording', cautions)]
    band = [each for each in cautions if each.code in _OF_FAULTY_SAMPLES]
    return band[:1] or _about('device', cautions) or [cautions[0]]


def of_faulty_samples(cautions: Sequence[Caution]) -> bool:
    """Whether samples by themselves tell that they are not what the parameters say."""
    return any(each.code in _OF_FAULTY_SAMPLES for each in cautions)


def with_those_of_samples(
    closed: bool, answer: Sequence[Caution], samples: Sequence[Caution]
) -> tuple[Caution, ...]:
    """Return what an answer and its samples tell, without what the other one refutes.

    A polygon that explains the echoes shows that samples are what they should be, and something else is loud where
    `echo_band` tells of it; where none closes, what is wrong with the samples is the cause.
    """
    if closed and not any(each.code in _OF_DOUBT for each in answer):
        return (*answer, *(each for each in samples if each.code != 'echo_band'))
    return (*of_the_first_stage(answer, () if closed else samples), *samples)


def of_the_first_stage(answer: Sequence[Caution], others: Sequence[Caution]) -> tuple[Caution, ...]:
    """Return the cautions of an answer that is open without those that send the user on for an earlier stage's fault.

    Parameters
    ----------
    answer : sequence of Caution
        Those of the answer itself.
    others : sequence of Caution
        Those beside it, of its samples or of the recording.
    """
    dropped = any(each.code == 'pings_dropped' for each in others)
    faulty = of_faulty_samples(others)
    return tuple(each for each in answer if not (dropped and each.code == 'too_few_pings')
                 and not (faulty and CAUTIONS[each.code].about == 'answer'))


def in_metres(length_m: float) -> str:
    """Return a length with no more figures than an operator reads: whole millimetres below 0.1 m."""
    if length_m < 0.1:
        return f'{1e3 * length_m:.0f} mm'
    return f'{length_m:.3g} m' if length_m < 1000.0 else f'{length_m:.0f} m'


def _about(stage: str, cautions: Sequence[Caution]) -> list[Caution]:
    return [each for each in cautions if CAUTIONS[each.code].about == stage]
