"""Whether stamps can be of one clock: the words for those that cannot."""

from collections.abc import Sequence

OTHER_CLOCK_NS = 1800 * 10**9
"""Stamps further apart than this are of different clocks: no ping waits half an hour for its odometry, and times of day
differ by an hour or more."""

NOT_STAMPED = 'its driver does not fill header.stamp'


def apart(ping_ns: int, odometry_ns: int | None) -> str:
    """Say that a ping and the odometry are stamped by different clocks, or not at all; empty where they may be one.

    Parameters
    ----------
    ping_ns : int
        Stamp of the ping [ns].
    odometry_ns : int or None
        Stamp of the odometry that is nearest to it [ns].
    """
    if odometry_ns is None or abs(ping_ns - odometry_ns) < OTHER_CLOCK_NS:
        return ''
    found = f'the echo is stamped {ping_ns * 1e-9:.3f} s, the odometry {odometry_ns * 1e-9:.3f} s'
    if ping_ns == 0 or odometry_ns == 0:
        whose = 'echo' if ping_ns == 0 else 'odometry'
        return f'{found}: the {whose} has stamps of 0, {NOT_STAMPED}'
    return f'{found}: that is another clock; both are to be stamped by one'


def apart_in_all(pings_ns: Sequence[int], odometry_ns: Sequence[int]) -> str:
    """Say when the pings and when the odometry are stamped; empty where the odometry's time covers the pings'.

    Parameters
    ----------
    pings_ns, odometry_ns : sequence of int
        Stamps, such as the first and the last one [ns].
    """
    if not pings_ns or not odometry_ns or (
            min(odometry_ns) <= min(pings_ns) and max(pings_ns) <= max(odometry_ns)):
        return ''
    echoes, odometry = (f'{min(stamps) * 1e-9:.3f} to {max(stamps) * 1e-9:.3f} s' for stamps in (pings_ns, odometry_ns))
    return f'the echoes are stamped {echoes}, the odometry {odometry}'
