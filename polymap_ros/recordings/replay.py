"""A recording through the mapper, in the order of log time."""

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import islice

from polymap_ros.acoustics.ping import Ping
from polymap_ros.cautions import Caution
from polymap_ros.errors import DROP_REASONS, BadOdometry, BadPing, RecordingError
from polymap_ros.hearing.clocks import NOT_STAMPED, apart_in_all
from polymap_ros.mapping.mapper import PolygonMapper
from polymap_ros.messages.echoes import ping_from_message
from polymap_ros.messages.fields import check_echo_fields
from polymap_ros.messages.odometry import odometry_from_cdr, stamped_pose
from polymap_ros.parameters import Parameters
from polymap_ros.recordings.reading import Message, Recording
from polymap_ros.recordings.sensor_places import sensor_places
from polymap_ros.solvers.map_verdict import MIN_PINGS

ODOMETRY_TYPE = 'nav_msgs/msg/Odometry'

_MANY = 1 / 3
"""Of the pings that were received, so many dropped for one reason are told before what the others gave: more than a
pause, or the start of a recording, costs."""

_WITHOUT_POSE = ('no_pose', 'pose_gap', 'stale', 'queue_full')

_OF_PARAMETERS = {
    'echo.sample_period_s': 'set echo.sample_period_s to what the device has, or to 0 where the messages tell it',
    'pulse.path': "resample the pulse to the echoes' rate",
    'front_end.gain_db_s': 'set front_end.gain_db_s to what the device does to the echoes, or to 0',
    'front_end.max_bad': 'lower the gain where the echoes are recorded, or raise front_end.max_bad',
    'front_end.band_': 'set front_end.band_low_hz and band_high_hz so that the pulse passes',
    'cannot hold a pulse': 'check the sample period in the messages, or echo.sample_period_s, and pulse.frequency_hz',
}
"""What to do about dropped pings by what their sentence names, where a parameter is at fault."""


@dataclass
class OdometryCounts:
    """What became of the odometry messages: received = used + dropped by reason."""

    received: int = 0
    used: int = 0
    dropped: Counter[str] = field(default_factory=Counter)


class Replay:
    """One pass over a recording; iterate over it to feed the mapper message by message.

    Parameters
    ----------
    recording : Recording
        Open.
    mapper : PolygonMapper
        Takes the poses and pings.
    parameters : Parameters
        Name the topics and say how to read the echoes.
    start_s, end_s : float, optional
        Half-open interval of log time after the recording's first message [s].

    Raises
    ------
    ParameterError
        For fields of the echoes that are not in their type.
    RecordingError
        For a topic that is missing, empty or of another type; while iterating, for a damaged file and where no
        odometry or no echo is in the interval.

    Attributes
    ----------
    before : callable or None
        Is shown each message, decoded in full, before the mapper gets it.
    """

    def __init__(
        self, recording: Recording, mapper: PolygonMapper, parameters: Parameters,
        start_s: float | None = None, end_s: float | None = None,
    ) -> None:
        self.odom_topic = recording.require(parameters.topics.odom, ODOMETRY_TYPE, 'topics.odom')
        self.echo_topic = recording.require(parameters.topics.echo, parameters.echo.type, 'topics.echo')
        check_echo_fields(parameters.echo, recording.fields_of)
        if parameters.sensor.from_tf:
            mapper.intake.locate = sensor_places(recording, self.odom_topic)
        self.topics = (self.odom_topic, self.echo_topic)
        self.total = sum(recording.topics[topic].message_count for topic in self.topics)
        self.odometry = OdometryCounts()
        self.echoes = 0
        self._stamps: set[int] = set()
        self._first_and_last: dict[str, tuple[int, int]] = {}
        self._recording, self._mapper, self._parameters = recording, mapper, parameters
        self._interval = start_s, end_s
        self._outliers = mapper.intake.outliers
        self.before: Callable[[Message], None] | None = None

    def __iter__(self) -> Iterator[Message]:
        """Feed the mapper; each message is given back once it was taken or dropped."""
        readers = {} if self.before else {self.odom_topic: odometry_from_cdr}
        for entry in self._recording.messages(self.topics, *self._interval, readers):
            if self.before:
                self.before(entry)
            if entry.topic == self.odom_topic:
                self._feed_odometry(entry)
            else:
                self._feed_echo(entry)
            yield entry
        damaged = self._recording.damaged
        for _ in range(damaged[self.echo_topic]):
            self.echoes += 1
            self._mapper.drop('bad_shape', f'{self.echo_topic}: the message {self._recording.why(self.echo_topic)}')
        if lost := damaged[self.odom_topic]:
            self.odometry.received += lost
            self.odometry.dropped['undecodable'] += lost
        self._mapper.finish()
        if outliers := self._mapper.intake.outliers - self._outliers:
            self.odometry.used -= outliers
            self.odometry.dropped['stamped_ahead'] += outliers
        self._check()

    def cautions(self) -> list[Caution]:
        """What is known to be missing from the recording, or was dropped of the odometry."""
        complete = self._interval == (None, None)
        found = self._recording.cautions(self.topics, complete)
        if self.odometry.dropped:
            reasons = ', '.join(f'{number} {reason}' for reason, number in sorted(self.odometry.dropped.items()))
            text = f'{self.odom_topic}: of {self.odometry.received} messages dropped: {reasons}'
            found.append(Caution('odometry_dropped', text))
        counts = self._mapper.counts
        most = max(counts.dropped.values(), default=0)
        many = most > _MANY * counts.received and most != counts.dropped.get('wrong_type')
        if many or (most and counts.used < MIN_PINGS):
            found.insert(0, self._dropped(found))
        elif refused := counts.dropped.get('wrong_type'):
            text = f'{self.echo_topic}: {refused} dropped: {self._mapper.intake.last_drop_texts["wrong_type"]}'
            found.append(Caution('wrong_type', text))
        return found

    def _dropped(self, found: list[Caution]) -> Caution:
        """Say why many pings were dropped; where poses were missing because of the odometry, that is to be mended."""
        counts = self._mapper.counts
        reason = max(counts.dropped, key=lambda key: (counts.dropped[key], key))
        number = sum(counts.dropped.values())
        of = 'all pings' if number == counts.received else f'{number} of {counts.received} pings'
        said = self._mapper.intake.last_drop_texts.get(reason, '')
        known = DROP_REASONS.get(reason)  # a saved state may count others
        remedy = next((each for name, each in _OF_PARAMETERS.items() if name in said), known.remedy if known else '')
        text = f'{of} were dropped, most as {reason}: {said.removesuffix(f"; {remedy}")}'
        blamed = [each for each in found if each.code == 'odometry_dropped' and reason in _WITHOUT_POSE]
        if reason in _WITHOUT_POSE and not blamed and 'stamp' not in said and 'frame' not in said and (
                stamps := apart_in_all(*(self._first_and_last.get(topic, ())
                                         for topic in (self.echo_topic, self.odom_topic)))):
            text += f' ({stamps})'
        return Caution('pings_dropped', text, blamed[0].text if blamed else remedy)

    def _feed_odometry(self, entry: Message) -> None:
        self.odometry.received += 1
        try:
            stamp_ns, frame_id, pose = stamped_pose(entry.message)
        except BadOdometry:
            self.odometry.dropped['bad_pose'] += 1
            return
        if len(self._stamps) < 2:
            self._stamps.add(stamp_ns)
        if self._mapper.add_pose(stamp_ns, pose, frame_id):
            self._note_stamp(entry.topic, stamp_ns)
            self.odometry.used += 1
        else:
            same_frame = frame_id == self._mapper.frame_id
            self.odometry.dropped['out_of_order' if same_frame else 'other_frame'] += 1

    def _feed_echo(self, entry: Message) -> None:
        self.echoes += 1
        try:
            ping = ping_from_message(entry.message, entry.type_name, self._parameters.echo, entry.log_ns)
        except BadPing as bad:
            self._mapper.drop(bad.reason, str(bad))
            return
        self._note_stamp(entry.topic, ping.stamp_ns)
        self._mapper.add_ping(ping)

    def _note_stamp(self, topic: str, stamp_ns: int) -> None:
        first_ns, last_ns = self._first_and_last.get(topic, (stamp_ns, stamp_ns))
        self._first_and_last[topic] = min(first_ns, stamp_ns), max(last_ns, stamp_ns)

    def _check(self) -> None:
        path = self._recording.path
        received = {self.odom_topic: self.odometry.received, self.echo_topic: self.echoes}
        for topic, number in received.items():
            if not number and self._recording.faults:
                raise RecordingError(f'{path}: no message of {topic} can be read: {self._recording.faults[0]}; copy '
                                     'the recording again from where it was made')
            if not number:
                duration_s = self._recording.duration_s
                raise RecordingError(f'{path}: no message of {topic} between --start and --end; the recording is '
                                     f'{duration_s:.3f} s long')
        reasons = ', '.join(f'{number} {reason}' for reason, number in sorted(self.odometry.dropped.items()))
        if self.odometry.dropped['out_of_order'] and len(self._stamps) == 1:
            (stamp_ns,) = self._stamps
            raise RecordingError(f'{path}: the stamps of {self.odom_topic} are all {stamp_ns * 1e-9:g}, and a pose is '
                                 f'of its time: {NOT_STAMPED}')
        if not self.odometry.used:
            most = max(self.odometry.dropped, key=lambda reason: self.odometry.dropped[reason])
            needed = {'undecodable': f'they {self._recording.why(self.odom_topic)}'}.get(
                most, 'a finite pose and a unit quaternion are needed')
            raise RecordingError(f'{path}: none of the {self.odometry.received} messages of {self.odom_topic} can be '
                                 f'used ({reasons}); {needed}')


def some_pings(
    recording: Recording, topic: str, parameters: Parameters, start_s: float | None, end_s: float | None,
    at_most: int = 200,
) -> list[Ping]:
    """Pings spread evenly over a recording, those that cannot be read left out."""
    step = max(1, -(-recording.topics[topic].message_count // at_most))
    pings = []
    for entry in islice(recording.messages([topic], start_s, end_s), 0, None, step):
        with suppress(BadPing):
            pings.append(ping_from_message(entry.message, entry.type_name, parameters.echo, entry.log_ns))
    return pings
