"""How well state and parameter errors are known: one covariance for all hypotheses on the stem.

It is followed in time as that of the best hypothesis; the others share it. The unknowns are those
of a `Belief`: the state of the process, then load, error of fD and relative error of the gain.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from compensator.kernels import next_state
from compensator.prediction import Prediction
from compensator.stem_tracking.belief import ERRORS, FRICTION, GAIN, LOAD
from compensator.stem_tracking.covariance_kernels import follow_covariance
from compensator.stem_tracking.load_steps import load_signature
from compensator.stem_tracking.tracker_settings import TrackerSettings
from loop_model import ValveModel

__all__ = ["SharedCovariance"]

Array = NDArray[np.float64]


class SharedCovariance:
    """Covariance of ``n`` states and `ERRORS` errors, shape ``(n + ERRORS, n + ERRORS)``.

    Args:
        prediction: the process with its disturbance at the input.
        settings: uncertainties and the ratios of the noise.
        settle: samples that the process takes to settle.

    Attributes:
        innovation: variance of PV that was expected last.
    """

    def __init__(self, prediction: Prediction, settings: TrackerSettings, settle: int) -> None:
        self._prediction, self._settings, self._settle = prediction, settings, settle
        n = prediction.order
        noise = settings.noise
        enters = np.append(prediction.equation_gain, np.zeros(ERRORS))
        self._cross = noise.equation**2 * enters
        self._q = noise.equation**2 * np.outer(enters, enters)
        # The load's drift per scan that makes the filter average over ``offset_memory``.
        density = (
            noise.equation**2 / float(prediction.B.sum()) ** 2
            + (noise.measurement / prediction.scale) ** 2
        )
        lasts = settings.level_memory if prediction.process.is_integrating else settle
        self._load_drift = density / (settings.offset_memory * lasts) ** 2
        self._load_walk = settings.load_walk**2 / lasts
        self._error_memory = 1.0 - 1.0 / (20.0 * lasts)
        self._transition = np.eye(n + ERRORS)
        self._transition[:n, :n] = prediction.A
        self._transition[:n, n + LOAD] = prediction.B
        for error in (FRICTION, GAIN):
            self._transition[n + error, n + error] = self._error_memory
        self._r = noise.equation**2 + noise.measurement**2
        self._values = np.zeros((n + ERRORS, n + ERRORS))
        self._next = np.zeros_like(self._values)
        self._gain = np.zeros(n + ERRORS)
        self._noise_now = self._scale_now = 0.0
        self.innovation = 1.0
        self._valve: ValveModel | None = None
        self._renewed = np.zeros((2, 2))

    def begin(self, valve: ValveModel) -> None:
        """Know nothing yet.

        The first PV may come from the middle of a move: the state is as uncertain as moves of the
        stick band's size make it.
        """
        prediction = self._prediction
        n = prediction.order
        self._values = np.zeros((n + ERRORS, n + ERRORS))
        reach = prediction.B * max(valve.stick_band, 1e-3)
        for _ in range(self._settle):
            self._values[:n, :n] += np.outer(reach, reach)
            reach = prediction.A @ reach
        self.innovation, self._noise_now, self._scale_now = 1.0, 0.0, 0.0
        self._gain = np.zeros(n + ERRORS)
        self.forget_errors(valve)

    @property
    def load_variance(self) -> float:
        """Variance of the load (OP squared)."""
        n = self._prediction.order
        return float(self._values[n, n])

    def gain(self, variance: float, colour: float, *, load_only: bool) -> Array:
        """Return the filter's gain: the correction of each state for an innovation of PV of one,
        shape ``(n + ERRORS,)``.

        Args:
            variance: of the noise, in units of the noise's ratios.
            colour: correlation of successive innovations. Correlated ones, which a model of too low
                an order leaves, correct the lasting errors less.
            load_only: whether the errors of fD and of the gain stay as they are.
        """
        n = self._prediction.order
        self._scale_now = variance
        self._noise_now = variance * self._r
        self.innovation = max(self._values.item(0), 0.0) + self._noise_now
        self._gain = self._values[:, 0] / self.innovation
        # Joseph's form, by which it is carried over, allows any gain.
        if colour > 0.0:
            self._gain[n:] *= (1.0 - colour) / (1.0 + colour)
        if load_only:
            self._gain[n + FRICTION] = self._gain[n + GAIN] = 0.0
        return self._gain

    def skip(self) -> None:
        """Pass a scan without PV."""
        self._gain = np.zeros_like(self._gain)

    def carry_over(self, way: float, turn: float, valve: ValveModel, colour: float) -> None:
        """Go on to the next scan, by Joseph's form (right for any gain).

        Args:
            way, turn: change of position and of direction by the best hypothesis's slip; 0 if it
                stayed.
            valve: the valve model; colour: see `gain`.
        """
        drift = self._scale_now * self._load_drift * (1.0 + colour) / (1.0 - colour)
        follow_covariance(
            self._values,
            self._next,
            self._transition,
            self._prediction.B,
            turn,
            way,
            self._gain,
            self._q,
            self._cross,
            self._scale_now,
            self._noise_now,
            self.innovation,
            drift + self._load_walk * valve.slip_jump**2,
            self._renewed_errors(valve),
        )
        self._values, self._next = self._next, self._values

    def add(self, spread: Array) -> None:
        """Add the spread of hypotheses that were merged."""
        self._values += spread

    def doubt_response(self, way: float) -> None:
        """Widen the state for an answer to a slip by ``way`` that comes a little early or late.

        An answer that is late lacks the pulse which the slip's first scan makes of the state, an
        early one has that of the next scan already. In a level both leave the same offset for ever,
        which counts once.
        """
        n = self._prediction.order
        late = self._settings.delay_spread * way * self._prediction.B
        self._values[:n, :n] += np.outer(late, late)
        if not self._prediction.process.is_integrating:
            early = next_state(self._prediction.A, late)
            self._values[:n, :n] += np.outer(early, early)

    def expect_load(self, scans: int, size: float) -> None:
        """Widen for a load step of about ``size`` (OP) that came ``scans`` ago."""
        n = self._prediction.order
        signature = np.zeros(n + ERRORS)
        signature[:n], signature[n + LOAD] = load_signature(self._prediction, scans), 1.0
        self._values += size**2 * np.outer(signature, signature)

    def doubt_load(self, variance: float) -> None:
        """Widen the load by ``variance`` (OP squared)."""
        n = self._prediction.order
        self._values[n, n] += variance

    def forget_errors(self, valve: ValveModel) -> None:
        """Go back to what the settings say of the errors' size."""
        n = self._prediction.order
        self._values[n:, :] = self._values[:, n:] = 0.0
        self._values[n:, n:] = self._prior_errors(valve)

    def _renewed_errors(self, valve: ValveModel) -> Array:
        """Return what comes back each scan of the covariance that the settings give the errors of
        fD and of the gain, shape ``(2, 2)``.
        """
        if valve is not self._valve:
            self._valve = valve
            self._renewed = (1.0 - self._error_memory**2) * self._prior_errors(valve)[1:, 1:]
        return self._renewed

    def _prior_errors(self, valve: ValveModel) -> Array:
        """Return the covariance that the settings give the errors ``(m, w, g)``."""
        prior = np.zeros((ERRORS, ERRORS))
        prior[LOAD, LOAD] = (0.5 * valve.static_friction + 1e-3) ** 2
        relative = self._settings.friction.error_covariance(valve, self._settings.gain_spread)
        # What drives the process is counted in the model's gain.
        prior[FRICTION:, FRICTION:] = self._settings.gain**2 * relative
        return prior
