"""List loops of the tuning family, and draw them on a contact sheet."""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmarks.families.loop import RecordedLoop
from benchmarks.families.tuning import HEALTHY_KINDS, KINDS, STICKY_KINDS, draw


def draw_all(kinds: list[str], seeds: list[int]) -> list[RecordedLoop]:
    """Sticky and healthy loops of every kind that has them."""
    return [
        draw(kind, sticky, seed)
        for kind in kinds
        for sticky, allowed in ((True, STICKY_KINDS), (False, HEALTHY_KINDS))
        if kind in allowed
        for seed in seeds
    ]


def plot_sheet(loops: list[RecordedLoop], file: Path, samples: int) -> None:
    """OP and PV against time and PV against OP, one loop a cell."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    columns = 3
    rows = -(-len(loops) // columns)
    figure, axes = plt.subplots(rows, 2 * columns, figsize=(24, 2.1 * rows), squeeze=False,
                                width_ratios=[4, 1] * columns)  # fmt: skip
    for axis in axes.flat:
        axis.axis("off")
    for place, loop in enumerate(loops):
        row, column = divmod(place, columns)
        time, phase = axes[row, 2 * column], axes[row, 2 * column + 1]
        for axis in (time, phase):
            axis.axis("on")
            axis.tick_params(labelsize=6)
        time.plot(loop.op[:samples], lw=0.7, color="tab:blue")
        twin = time.twinx()
        twin.plot(loop.pv[:samples], lw=0.6, color="tab:red")
        twin.tick_params(labelsize=6)
        phase.plot(loop.op[:samples], loop.pv[:samples], lw=0.4, color="black")
        truth = (
            f"S {loop.stick_band:.1f} J {loop.slip_jump:.1f}" if loop.law != "none" else "healthy"
        )
        doubt = "" if loop.assessable else " NOT ASSESSABLE"
        time.set_title(
            f"{loop.name} {loop.law} {truth} n {len(loop.op)} strokes {loop.strokes}{doubt}\n"
            f"{loop.notes}",
            fontsize=6,
        )
    figure.tight_layout()
    figure.savefig(file, dpi=70)
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(prog="benchmarks.families.tuning", description=__doc__)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS), metavar="KIND")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    parser.add_argument("--plot", type=Path, metavar="FILE.png", help="write a contact sheet")
    parser.add_argument("--samples", type=int, default=600, help="samples shown of each loop")
    chosen = parser.parse_args()
    loops = draw_all(chosen.kinds, chosen.seeds)
    for loop in loops:
        print(
            f"{loop.name:20} {loop.law:8} S {loop.stick_band:5.2f} J {loop.slip_jump:5.2f} "
            f"n {len(loop.op):5} strokes {loop.strokes:4} "
            f"{'assessable' if loop.assessable else 'not assessable':14} {loop.notes}"
        )
    if chosen.plot is not None:
        plot_sheet(loops, chosen.plot, chosen.samples)


if __name__ == "__main__":
    main()
