"""Whether a plant may still be called: it runs, has ended, has failed, or must never be called."""

from __future__ import annotations

from collections.abc import Sequence

from fmpy.fmi1 import FMICallException

from .errors import PlantClosedError, PlantEndedError, PlantStepError
from .instances import EndedError, StoppedError
from .library import describe_refusal, is_fatal, last_words

__all__ = ["PlantCondition"]

_SHOWN = 5
"""Names in a message."""


class PlantCondition:
    """The condition of one instance; every refusal of the FMU goes through here.

    Args:
        name: of the plant, for messages.

    Attributes:
        failure: why it cannot go on; None while it can.
        ended: whether the FMU ended its simulation in order.
        fatal: whether FMI forbids every further call.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self.failure: str | None = None
        self.ended = False
        self.fatal = False

    @property
    def healthy(self) -> bool:
        """Whether the instance may be terminated in order."""
        return self.failure is None or self.ended

    def check_alive(self) -> None:
        """Raise PlantClosedError where the plant has ended or failed."""
        if self.failure is not None:
            how = "has ended" if self.ended else "failed before"
            raise PlantClosedError(f"the plant {how}: {self.failure}")

    def check_callable(self) -> None:
        """Raise PlantClosedError where FMI forbids to call the instance, for whatever purpose."""
        if self.fatal:
            raise PlantClosedError(
                f"plant {self._name} must not be called any more: {self.failure}; open it "
                "again, isolated in a process of its own"
            )

    def revive(self) -> None:
        """A state was restored: it goes on."""
        self.failure, self.ended = None, False

    def refuse_start(self, error: Exception) -> PlantStepError:
        """Return the error of a start that was refused."""
        self.fatal = is_fatal(error)
        return self.fail(f"plant {self._name} refused to start: {describe_refusal(error)}")

    def refuse_reading(self, error: FMICallException, outputs: Sequence[str]) -> PlantStepError:
        """Return the error of an FMU that does not give its outputs once it has started."""
        self.fatal = is_fatal(error)
        more = ", ..." if len(outputs) > _SHOWN else ""
        return self.fail(
            f"plant {self._name} does not give its outputs ({', '.join(outputs[:_SHOWN])}{more}): "
            f"{describe_refusal(error)}; where its library lacks one of them, description and "
            "library are of two builds: export the FMU again as a whole"
        )

    def refuse_step(
        self, error: FMICallException | StoppedError, time: float, period: float
    ) -> PlantStepError:
        """Return the error of a step from ``time`` by ``period`` seconds that was refused."""
        text = (
            f"plant {self._name}: the step from {time:g} s by {period:g} s failed: "
            f"{describe_refusal(error)}"
        )
        if is_fatal(error):
            self.fatal = True
            text += "; after a fatal status FMI allows no further call of this instance"
        return self.fail(text)

    def fail(self, text: str) -> PlantStepError:
        """Take note of a failure, and return it as an error."""
        self.failure = text
        return PlantStepError(text)

    def end(self, error: EndedError) -> PlantEndedError:
        """Take note that the FMU has ended, and return it as an error."""
        self.ended = True
        self.failure = f"plant {self._name}: {error} (has it reached its stop time?){last_words()}"
        return PlantEndedError(self.failure)
