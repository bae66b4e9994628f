"""Labels of logarithmic axes are plain text, so that no figure loads a mathematical font."""

import matplotlib as mpl
import matplotlib.mathtext
import numpy as np
import pytest
from matplotlib.figure import Figure

from treadline.report.svg_figures import STYLE, plain_log_labels, svg_of


def labels(low: float, high: float, scale: str = "log") -> list[str]:
    with mpl.rc_context(STYLE):
        ax = Figure().subplots()
        ax.set_yscale(scale)
        ax.set_ylim(low, high)
        plain_log_labels(ax.yaxis)
        ax.figure.draw_without_rendering()
        return [tick.get_text() for tick in (*ax.get_yticklabels(), *ax.get_yticklabels(minor=True)) if tick.get_text()]


def test_decades_and_their_multiples_are_powers_in_superscript_with_a_true_minus() -> None:
    assert {"10⁻³", "10⁻²", "10⁻¹", "10⁰", "10¹"} <= set(labels(1e-3, 10.0))
    assert "10¹²" in labels(1e11, 1e13)
    assert {"2×10⁻²", "4×10⁻²"} <= set(labels(0.015, 0.045))
    assert {"−10¹", "0", "10¹"} <= set(labels(-50.0, 50.0, "symlog"))


def test_a_figure_with_dollars_and_decades_loads_no_mathematical_font(monkeypatch: pytest.MonkeyPatch) -> None:
    def parse(*_: object, **__: object) -> None:
        raise AssertionError("formula layout")

    monkeypatch.setattr(matplotlib.mathtext.MathTextParser, "parse", parse)
    with mpl.rc_context(STYLE):
        figure = Figure()
        ax = figure.subplots()
        ax.loglog(np.logspace(-3, 3), np.logspace(-3, 3))
        ax.set_title("cost_$ per $")
        plain_log_labels(ax.xaxis)
        plain_log_labels(ax.yaxis)
    assert svg_of(figure).startswith("<svg")
