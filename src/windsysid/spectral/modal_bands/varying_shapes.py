"""Vibration whose shape varies over a band: a rival explanation of its modes.

Between two modes of a structure, the response is the sum of their skirts and of the quasi-static response, and its
shape (operating deflection shape) varies smoothly with frequency. Where a few loads move several sensors almost without
noise, as those of a rotor move the sensors along its tower, a background of one shape does not fit, and additional
modes represent the variation. So each mode is compared with a mixing of the channels that varies with frequency,
linearly or as a parabola, whichever is more evident (`windsysid.spectral.modal_bands.model`), with the other modes of
its band and without any.
"""

from collections.abc import Sequence

import numpy as np

from windsysid.spectral.modal_bands.model import Modes, height_of
from windsysid.spectral.modal_bands.scoring import COARSE_TOLERANCE, ModalFit, evidence, score
from windsysid.spectral.modal_bands.start import modes_at, without_modes
from windsysid.spectral.transforms.dft import Band

__all__ = ["background_log_odds"]

MAX_STEPS = 60
"""Numerical: largest number of steps of a search."""


def background_log_odds(fit: ModalFit, band: Band, bins: int, wanted: Sequence[int]) -> list[float]:
    """Log odds of vibration of varying shape against each wanted mode of a fit of a band: of the most evident fit
    without the mode against the most evident one with it."""
    if not wanted:
        return []
    goal, start = evidence(fit, bins), without_modes(band)

    def search(start: Modes) -> ModalFit:
        """The fit from a start, which is given up where it cannot be as evident as the given fit."""
        target = goal - start.size * float(np.log(bins))
        return score(start, band, max_steps=MAX_STEPS, tolerance=COARSE_TOLERANCE, target=target)

    orders = (np.zeros((order, *start.rest.shape), dtype=np.complex128) for order in (1, 2))
    empty = min((search(start._replace(mix=mix)) for mix in orders), key=lambda one: evidence(one, bins))
    back = np.linalg.inv(empty.modes.mixing_at(height_of(band.frequency, band)))
    apart = band._replace(power=np.ascontiguousarray(back @ band.power @ back.conj().transpose(0, 2, 1)))
    known = list(zip(fit.modes.frequency.tolist(), fit.modes.damping.tolist(), strict=True))

    found = []
    for f, z in (known[j] for j in wanted):
        least = {True: goal, False: evidence(empty, bins)}
        others = [one for one in known if one != (f, z)]
        for number, which in enumerate((others, [(f, z)], known if others else [])):
            if which and (number == 0 or least[False] < least[True]):
                more = search(modes_at(which, apart)._replace(mix=empty.modes.mix))
                off = np.abs(np.log(more.modes.frequency / f))
                with_it = bool(np.any(off < np.maximum(more.modes.damping, z)))
                least[with_it] = min(least[with_it], evidence(more, bins))
        found.append(0.5 * (least[True] - least[False]))
    return found
