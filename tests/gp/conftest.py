"""What the tests of Gaussian processes share."""

import pytest

from exposight.gp.likelihood import MarginalLikelihood


@pytest.fixture(scope="session")
def gradient_of():
    """Gradient of a process's likelihood by its kernel's logarithms, then the noise's."""

    def gradient(process):
        active = ~process.kernel.gate(process.x)
        likelihood = MarginalLikelihood(process.x, process.y, active=active)
        return likelihood.value_and_gradient(process.kernel, process.noise_variance)[1]

    return gradient
