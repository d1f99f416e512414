"""Whether stamps can be of one clock: the words for those that cannot."""

OTHER_CLOCK_NS = 3600 * 10**9
"""Stamps further apart than this are of different clocks: no ping waits an hour for its odometry."""

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
