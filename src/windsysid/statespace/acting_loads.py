"""The loads that act, from the states that they are made of: w = H(ψ) z."""

import numpy as np

from windsysid._types import Array
from windsysid.statespace.compose import StateSpace

__all__ = ["acting_loads"]


def acting_loads(model: StateSpace, inputs: Array) -> tuple[tuple[str, ...], Array]:
    """The n_w loads that are states: their names, and H(ψ) at each sample of the inputs (T, n_w, n_z)."""
    compiled, blocks = model.compiled, model.blocks
    driven = np.any(blocks.load_output != 0.0, axis=(0, 2))
    names = tuple(name for name, is_driven in zip(compiled.loads, driven, strict=True) if is_driven)
    psi = inputs[:, blocks.azimuth[0]] if blocks.azimuth[0] >= 0 else np.zeros(len(inputs))
    k = np.arange(1, (len(blocks.load_output) + 1) // 2)
    turn = np.ones((len(inputs), len(blocks.load_output)))
    turn[:, 1::2], turn[:, 2::2] = np.cos(np.outer(psi, k)), np.sin(np.outer(psi, k))
    return names, np.asarray(np.einsum("tk,kwz->twz", turn, blocks.load_output[:, driven]))
