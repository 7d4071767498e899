"""Panels that a picture places itself stay where they are in somebody's figure."""

import numpy as np
from matplotlib.figure import Figure

from windsysid.reports.figures.plots import _panels


def test_a_layout_of_the_figure_does_not_pile_panels_up():
    figure = Figure(figsize=(10.0, 4.0), layout="constrained")
    boxes = ((1.0, 0.5, 4.5, 3.5), (6.0, 0.5, 9.5, 3.5))
    left, right = (_panels(figure, box, heights=[3, 1], apart=0.1) for box in boxes)
    figure.draw_without_rendering()
    for axes, (x_0, y_0, x_1, y_1) in zip((left, right), boxes, strict=True):
        low, high = axes[-1].get_position(), axes[0].get_position()
        placed = low.x0, low.y0, high.x1, high.y1
        assert np.allclose(placed, (x_0 / 10.0, y_0 / 4.0, x_1 / 10.0, y_1 / 4.0))
