"""The notebooks of `examples/notebooks` run as they are, and records and results show themselves with a picture."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import windsysid as ws
from windsysid.records.record import Record
from windsysid.reports.figures.canvas import DisplayedFigure

NOTEBOOKS = sorted((Path(__file__).parents[1] / "examples" / "notebooks").glob("*.ipynb"))
PICTURES = {"first_identification": 3, "modes_without_a_model": 2, "two_records": 1}
"""Cells that show a picture, by notebook."""


def code_of(notebook: Path) -> list[ast.Module]:
    """The cells of code of a notebook."""
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    return [ast.parse("".join(cell["source"])) for cell in cells if cell["cell_type"] == "code"]


def has_picture(value: object) -> bool:
    """Whether a notebook shows a value with a picture."""
    html = value._repr_html_() if hasattr(value, "_repr_html_") else ""
    return hasattr(value, "_repr_png_") or "image/png" in (html or "")


@pytest.mark.parametrize(
    "notebook",
    NOTEBOOKS,
    ids=lambda path: path.stem,
)
@pytest.mark.slow
def test_the_cells_of_a_notebook_run_and_show_pictures(notebook: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Without a kernel: what a cell ends with is what it shows."""
    monkeypatch.chdir(tmp_path)
    known: dict[str, object] = {}
    pictures = 0
    for cell in code_of(notebook):
        last = cell.body.pop() if isinstance(cell.body[-1], ast.Expr) else None
        exec(compile(cell, notebook.name, "exec"), known)
        if isinstance(last, ast.Expr):
            pictures += has_picture(eval(compile(ast.Expression(last.value), notebook.name, "eval"), known))
    assert pictures == PICTURES[notebook.stem]


@pytest.mark.slow
@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_shows_pictures(notebook: Path, tmp_path: Path):
    copy = tmp_path / notebook.name  # a kernel works where its notebook lies
    copy.write_bytes(notebook.read_bytes())
    command = [sys.executable, "-m", "nbconvert", "--execute", "--to", "notebook", "--output=ran", str(copy)]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    cells = json.loads((tmp_path / "ran.ipynb").read_text(encoding="utf-8"))["cells"]
    shown = [json.dumps(cell.get("outputs", [])) for cell in cells]
    assert sum("image/png" in one for one in shown) == PICTURES[notebook.stem]


def test_a_record_draws_its_channels_and_says_what_is_left_out():
    rng = np.random.default_rng(1)
    names = tuple(f"floor_{i}_x_acceleration" for i in range(14))
    readings = rng.standard_normal((4000, 14))
    readings[:, 3] = np.nan
    figure = Record(np.arange(4000) / 20.0, readings, names, ("m/s²",) * 14).plot()
    assert len(figure.axes) == 12
    assert "2 more channels" in figure.axes[-1].get_xlabel()
    assert "no reading" in [text.get_text() for text in figure.axes[3].texts]


def test_figures_and_records_are_pictures_in_a_notebook():
    record = ws.simulate("tower", duration=60.0, rate=5.0, seed=1)
    figure = record.plot()
    assert isinstance(figure, DisplayedFigure)
    assert figure._repr_png_().startswith(b"\x89PNG")
    assert "data:image/png;base64," in record._repr_html_()
    assert "data:image/png;base64," in ws.inspect(record)._repr_html_()
