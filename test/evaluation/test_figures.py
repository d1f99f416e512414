import numpy as np
import pytest

from polymap_ros.evaluation.figures import convergence_figure, success_figure
from polymap_ros.evaluation.paper_experiment import History


@pytest.fixture
def make_history(make_trial):
    def make(scene, run, iterations=50):
        generator = np.random.default_rng(run)
        return History(scene, 4, make_trial(scene=scene, run=run), -np.sort(generator.random(iterations)),
                       generator.integers(3, 9, iterations), np.sort(generator.random(iterations)))
    return make


def test_success_is_drawn_per_method_in_percent(make_trial):
    trials = [make_trial(seed, edges, method, right=(seed < 3 * (edges == 3)) and method == 'paper')
              for seed in range(4) for edges in (3, 6) for method in ('paper', 'rectangle')]
    figure = success_figure(trials, 'plates')
    axes, = figure.axes
    assert [text.get_text() for text in figure.texts] == ['plates']
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ['paper', 'rectangle']
    paper, rectangle = (container.lines[0] for container in axes.containers)
    np.testing.assert_allclose(paper.get_ydata(), [75.0, 0.0])
    np.testing.assert_allclose(rectangle.get_ydata(), [0.0, 0.0])
    np.testing.assert_allclose(paper.get_xdata(), [3, 6], atol=0.2)
    np.testing.assert_array_equal(axes.get_xticks(), [3, 6])


def test_success_over_the_snr_is_drawn_beside_that_over_the_edges(make_trial, tmp_path):
    trials = [make_trial(seed, edges, method, snr_db=snr_db, right=snr_db > -20.0 * (edges == 3) - 5.0 * seed)
              for seed in range(4) for edges in (3, 6) for method in ('paper', 'rectangle')
              for snr_db in (0.0, -10.0, -20.0)]
    figure = success_figure(trials, 'plates')
    over_edges, over_snr = figure.axes
    paper = over_edges.containers[0].lines[0]
    np.testing.assert_allclose(paper.get_xdata(), [3, 6], atol=0.2)
    np.testing.assert_allclose(paper.get_ydata(), [100.0, 75.0])
    paper = over_snr.containers[0].lines[0]
    np.testing.assert_allclose(paper.get_xdata(), [-20, -10, 0], atol=0.2)
    np.testing.assert_allclose(paper.get_ydata(), [37.5, 62.5, 87.5])
    figure.savefig(tmp_path / 'figure.png')
    assert (tmp_path / 'figure.png').stat().st_size > 10_000


def test_convergence_has_a_column_per_scene_with_medians_and_baseline(make_history, tmp_path):
    runs = {name: [make_history(name, run) for run in (1, 2, 3)] for name in ('triangle', 'rectangle')}
    figure = convergence_figure(runs, {'rectangle': 0.97})
    assert len(figure.axes) == 6
    for column, name in enumerate(runs):
        for row, quantity in enumerate(('cost', 'edges', 'iou')):
            values = np.array([getattr(run, quantity) for run in runs[name]])
            lines = figure.axes[2 * row + column].lines
            np.testing.assert_array_equal([line.get_ydata() for line in lines[:3]], values)
            np.testing.assert_array_equal(lines[3].get_ydata(), np.median(values, axis=0))
            assert lines[3].get_color() == 'tab:red'
    assert 0.97 in figure.axes[5].lines[-1].get_ydata()
    assert len(figure.axes[4].lines) == 4
    figure.savefig(tmp_path / 'figure.png')
    assert (tmp_path / 'figure.png').stat().st_size > 10_000
