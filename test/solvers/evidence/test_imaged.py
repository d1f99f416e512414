"""Of the answers over the whole range and up to the horizon the better one stays, told apart by what each explains."""

from types import SimpleNamespace

import pytest

from polymap_ros.solvers.evidence import imaged as module
from polymap_ros.solvers.evidence.imaged import imaged

ENOUGH = 0.96


def answer(explained, name):
    return SimpleNamespace(wave=name, storey=(), explained=explained, walls=name)


class Range:
    """A search over data of some excess, which judges answers as `judged` says."""

    def __init__(self, excess, judged=None):
        self.data, self.judged = SimpleNamespace(excess=excess), judged

    def over(self, data):
        return data

    def again(self, found):
        assert found.wave == 'whole'
        return self.judged


@pytest.fixture
def answers(monkeypatch):
    """Two ranges, and what is found in each without its corners' echoes."""
    def given(whole, near, judged=None, near_holds=0.5):
        search, sooner = Range(1.0), Range(near_holds, judged)
        found = {search: whole, sooner: near}
        monkeypatch.setattr(module, 'up_to_horizon', lambda data, walls: sooner)
        monkeypatch.setattr(module, '_without_corners', lambda over, _: (over, found[over]))
        monkeypatch.setattr(module, '_over_without_corners', lambda over, _: over)
        monkeypatch.setattr(module, '_without_corner_edges', lambda over, better: (over, better))
        return search, sooner
    return given


FOUND = answer(0.7, 'found')


@pytest.mark.parametrize(('whole', 'near', 'judged', 'kept'), [
    (0.97, 0.99, 0.99, 'whole'),  # enough: nothing else is looked for
    (0.93, 0.98, 0.95, 'near'),
    (0.93, 0.94, 0.98, 'judged'),  # the walls of the whole range explain more up to the horizon, too
    (0.93, None, 0.97, 'judged'),
    (0.93, None, None, 'whole'),
    (0.93, 0.6, 0.65, 'whole'),  # up to the horizon neither is clearly more than was found
    (None, 0.95, None, 'near'),
    (None, None, None, 'found'),
    (0.75, 0.8, 0.7, 'found'),
])
def test_the_better_of_both_ranges_stays(answers, whole, near, judged, kept):
    made = {name: None if share is None else answer(share, name) for name, share in (
        ('whole', whole), ('near', near), ('judged', judged))} | {'found': FOUND}
    search, sooner = answers(made['whole'], made['near'], made['judged'])
    over, found = imaged(search, FOUND, ENOUGH)
    assert found is made[kept]
    assert over is {'whole': search, 'found': search}.get(kept, sooner)


def test_where_little_is_nearer_than_the_horizon_the_whole_range_counts(answers):
    search, _ = answers(answer(0.93, 'whole'), answer(0.99, 'near'), None, near_holds=0.2)
    assert imaged(search, FOUND, ENOUGH)[1].explained == 0.93
