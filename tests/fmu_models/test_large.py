"""FMUs with thousands of variables."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from fmu_models import summarise

Alter = Callable[[Path, Callable[[str, bytes], bytes | None]], Path]


def test_an_fmu_with_thousands_of_variables_is_described(
    mini_fmus: dict[str, Path], altered: Alter
) -> None:
    """Its structure is checked, the grammar of each name is not; a complaint has an end."""
    count = 5000

    def grow(name: str, content: bytes) -> bytes:
        more = "".join(
            f'<ScalarVariable name="signals.y[{k}]" valueReference="1" causality="output" '
            f'variability="continuous" initial="calculated"><Real/></ScalarVariable>'
            for k in range(1, count + 1)
        )
        end = b"</ModelVariables>"
        return content.replace(end, more.encode() + end) if name.endswith(".xml") else content

    summary = summarise(altered(mini_fmus["fmi2"], grow))
    complaints = [text for text in summary.warnings if "ModelStructure" in text]
    assert complaints
    assert max(map(len, summary.warnings)) < 400
    assert all(summary.variable(f"signals.y[{k}]") for k in range(1, count + 1))
