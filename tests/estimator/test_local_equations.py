"""Normal equations of rows that are zero outside a stretch, against NumPy's."""

import numpy as np
import pytest
from scipy.signal import lfilter

from estimator.algebra import local_equations, orthonormal


@pytest.mark.parametrize("pole", [0.0, 0.8, 1.0])
def test_equations_of_local_rows_are_those_of_whole_ones(pole: float) -> None:
    """Pulses through a lag: over at once, after a while, and never; one row is zero."""
    rng = np.random.default_rng(4)
    pulses = np.zeros((9, 300))
    for i, row in enumerate(pulses[:8]):
        row[30 * i + 5 : 30 * i + 25] = rng.normal(size=20)
    rows = lfilter([1.0], [1.0, -pole], pulses)
    basis = orthonormal(rng.normal(size=(3, 300)))
    outside = np.eye(300) - basis.T @ basis
    target = outside @ rng.normal(size=300)
    gram, right = local_equations(rows, basis, target)
    assert gram == pytest.approx(rows @ outside @ rows.T, rel=1e-8, abs=1e-8)
    assert right == pytest.approx(rows @ target, rel=1e-8, abs=1e-8)
    assert (gram == gram.T).all()
