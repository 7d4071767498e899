"""Beliefs on disk: a filter that resumes from a file computes the same, bit for bit, as without a stop.

A NumPy archive (.npz) holds the four fields of the belief as they are in memory, the names of the model's states, and a
mark that says what it is. It is written next to its place and moved there whole, so that an interruption leaves the
last one.
"""

import zipfile
from pathlib import Path

import numpy as np

from windsysid.errors import ConfigurationError
from windsysid.filters.protocol import Belief
from windsysid.output.files import claim_file
from windsysid.statespace.compose import StateSpace

__all__ = ["load_belief", "save_belief"]

MARK = "windsysid belief 1"

_KIND = "expected a file written by save_belief, got one that is damaged or of another kind"


def save_belief(path: str | Path, model: StateSpace, belief: Belief, *, overwrite: bool = False) -> None:
    """Save the belief of a filter of `model` to a file.

    Parameters
    ----------
    path : str or Path
        File to write; a missing folder is made.
    model : StateSpace
        Model of the belief.
    belief : Belief
        State of a Gaussian filter.
    overwrite : bool, default False
        Replace an existing file.

    Raises
    ------
    OutputError
        If the file exists and `overwrite` is False, or it cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import sympy as sp
    >>> import windsysid as ws
    >>> q, v, w, k = sp.symbols("q v w k")
    >>> spring = ws.models.Equations("spring", (q, v), (), (k,), (w,), (v, w - 0.2 * v - k * q))
    >>> sensor = ws.models.Reading("position", q, noise=0.01)
    >>> model = ws.models.compose(spring, rate=20.0, values={"k": 4.0}, sensors=[sensor])
    >>> path = Path(tempfile.mkdtemp()) / "belief.npz"
    >>> ws.filters.save_belief(path, model, ws.filters.EKF.init(model))
    >>> path.exists()
    True
    """
    states = np.array(model.states, dtype=np.str_)
    with claim_file(path, overwrite=overwrite) as write:
        write(lambda file: np.savez(file, mark=np.array(MARK), states=states, **belief._asdict()))


def load_belief(path: str | Path, model: StateSpace) -> Belief:
    """Load the belief of a filter that `save_belief` wrote, for a model of the same states and inputs.

    Parameters
    ----------
    path : str or Path
        File to read.
    model : StateSpace
        Model of the belief.

    Returns
    -------
    Belief
        As it was saved: the filter continues from it.

    Raises
    ------
    ConfigurationError
        If the file is missing, damaged, not a checkpoint, or of another model.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import sympy as sp
    >>> import windsysid as ws
    >>> q, v, w, k = sp.symbols("q v w k")
    >>> spring = ws.models.Equations("spring", (q, v), (), (k,), (w,), (v, w - 0.2 * v - k * q))
    >>> sensor = ws.models.Reading("position", q, noise=0.01)
    >>> model = ws.models.compose(spring, rate=20.0, values={"k": 4.0}, sensors=[sensor])
    >>> path = Path(tempfile.mkdtemp()) / "belief.npz"
    >>> ws.filters.save_belief(path, model, ws.filters.EKF.init(model))
    >>> ws.filters.load_belief(path, model).mean.tolist()
    [0.0, 0.0]
    """
    path = Path(path)
    try:
        with np.load(path, allow_pickle=False) as file:
            content = {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise ConfigurationError(f"checkpoint {path}: no such file: start without it") from None
    except (OSError, EOFError, ValueError, AttributeError, TypeError, NotImplementedError, zipfile.BadZipFile):
        raise ConfigurationError(f"checkpoint {path}: {_KIND}: start without it, or restore it") from None
    if str(content.get("mark")) != MARK or not {*Belief._fields, "states"} <= content.keys():
        raise ConfigurationError(f"checkpoint {path}: {_KIND}: start without it, or restore it")
    if tuple(content["states"].tolist()) != model.states or content["inputs"].shape != (len(model.inputs),):
        raise ConfigurationError(
            f"checkpoint {path}: it belongs to another model: expected the states {', '.join(model.states)}, "
            f"got {', '.join(content['states'].tolist())}"
        )
    return Belief(content["mean"], content["cov"], content["inputs"], int(content["samples"]))
