"""A controller that knows nothing of its own success, made fit for a `Supervisor`."""

from __future__ import annotations

from collections.abc import Callable

from compensator.action import Action, Controller
from compensator.hybrid.controller import HybridMpc, HybridSettings
from compensator.prediction import Prediction
from loop_model import LoopModel, ValveModel

__all__ = ["Followed"]


class Followed:
    """A compensating method with an estimator beside it, which tells what a `Supervisor` asks for.

    Args:
        build: makes the controller for a model; called again when the valve's parameters change.
        model: valve and process.
        settings: of the estimator.

    Raises:
        CompensatorError: the model cannot be controlled.
    """

    def __init__(
        self,
        build: Callable[[LoopModel], Controller],
        model: LoopModel,
        settings: HybridSettings | None = None,
    ) -> None:
        self._build = build
        self._controller = build(model)
        self._estimator = HybridMpc(model, settings)

    @property
    def model(self) -> LoopModel:
        """The model in use."""
        return self._estimator.model

    @property
    def prediction(self) -> Prediction:
        """The process of the model."""
        return self._estimator.prediction

    @property
    def ready(self) -> bool:
        """Whether a PV was ever seen."""
        return self._estimator.ready

    @property
    def is_moving(self) -> bool:
        """Whether the last OP moved the stem."""
        return self._estimator.stem_moved

    @property
    def load_stepped(self) -> bool:
        """Whether the last PV showed a step of the load."""
        return self._estimator.load_stepped

    @property
    def opposed(self) -> bool:
        """Whether PV answers to OP against the sign of the model's gain."""
        return self._estimator.opposed

    @property
    def horizon(self) -> int:
        """Samples that the estimator's plans look ahead: twice the settling time."""
        return self._estimator.horizon

    @property
    def held_variance(self) -> float:
        """Variance of PV that noise alone makes, the stem held."""
        return self._estimator.held_variance

    def improve_on(self, deviation: float, travel: float) -> None:
        """See `HybridMpc.improve_on`."""
        self._estimator.improve_on(deviation, travel)

    def change_valve(self, valve: ValveModel) -> None:
        """Go on with other valve parameters; the controller starts again with them."""
        self._estimator.change_valve(valve)
        self._controller = self._build(self.model)

    def require_reachable(self, valve: ValveModel) -> tuple[float, float]:
        """See `HybridMpc.require_reachable`."""
        return self._estimator.require_reachable(valve)

    def observe(self, pv: float, op: float) -> None:
        """See `Controller.observe`."""
        self._estimator.observe(pv, op)
        self._controller.observe(pv, op)

    def decide(self, sp: float) -> Action:
        """See `Controller.decide`."""
        return self._controller.decide(sp)
