"""Kernels are one code path: compiled where numba is there, plain Python with one warning where it is not."""

import subprocess
import sys

import numpy as np
import pytest

from polymap_ros.acoustics import image_sources

WITHOUT_NUMBA = """
import sys
sys.modules['numba'] = None
from polymap_ros.acoustics.image_sources import trace_images, visible_images
assert type(trace_images).__name__ == 'function'
images = visible_images([(0, 0), (1, 0), (1.3, 0.7), (0.6, 1.2), (-0.2, 0.6)], (0.5, 0.4), 4)
print(' '.join(f'{d:.17g}' for d in images.distance_m))
"""


def test_compiled_and_plain_kernels_agree():
    numba = pytest.importorskip('numba')
    assert isinstance(image_sources.trace_images, numba.core.registry.CPUDispatcher)
    run = subprocess.run([sys.executable, '-c', WITHOUT_NUMBA], capture_output=True, text=True, check=True, timeout=60)
    plain = np.array(run.stdout.split(), dtype=float)
    corners = [(0, 0), (1, 0), (1.3, 0.7), (0.6, 1.2), (-0.2, 0.6)]
    assert plain == pytest.approx(image_sources.visible_images(corners, (0.5, 0.4), 4).distance_m, rel=1e-12)
    assert run.stderr.count('numba is not installed') == 1
