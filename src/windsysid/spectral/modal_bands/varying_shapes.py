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

MAX_STEPS, FAINT = 60, 0.1
"""Numerical: largest number of steps of a search; scale of the load of a mode that is added to a background."""


def background_log_odds(fit: ModalFit, band: Band, bins: int, which: Sequence[int]) -> list[float]:
    """Log odds of vibration of varying shape against some modes of a band, by their indices in the fit: of the most
    evident fit without the mode against the most evident one with it."""
    if not which:
        return []
    goal, background = evidence(fit, bins), without_modes(band)

    def search(start: Modes) -> ModalFit:
        """The fit from a start, which is given up where it cannot be as evident as the given fit."""
        target = goal - start.size * float(np.log(bins))
        return score(start, band, max_steps=MAX_STEPS, tolerance=COARSE_TOLERANCE, target=target)

    orders = (np.zeros((order, *background.rest.shape), dtype=np.complex128) for order in (1, 2))
    empty = min((search(background._replace(mix=mix)) for mix in orders), key=lambda one: evidence(one, bins))
    back = np.linalg.inv(empty.modes.mixing_at(height_of(band.frequency, band)))
    apart = band._replace(power=np.ascontiguousarray(back @ band.power @ back.conj().transpose(0, 2, 1)))
    known = list(zip(fit.modes.frequency.tolist(), fit.modes.damping.tolist(), strict=True))

    def vibration_and(modes: Sequence[tuple[float, float]]) -> Modes:
        return modes_at(modes, apart)._replace(mix=empty.modes.mix)

    def log_odds(f: float, z: float) -> float:
        least, others = {True: goal, False: evidence(empty, bins)}, [one for one in known if one != (f, z)]

        def compare(*starts: Modes) -> None:
            for one in map(search, starts):
                off = np.abs(np.log(one.modes.frequency / f))
                with_mode = bool(np.any(off < np.maximum(one.modes.damping, z)))
                least[with_mode] = min(least[with_mode], evidence(one, bins))

        if others:
            compare(vibration_and(others))
        if least[False] < least[True]:
            added = vibration_and([(f, z)])
            faint = added._replace(load=FAINT * added.load, rest=empty.modes.rest, rest_slope=empty.modes.rest_slope)
            compare(added, faint, *([vibration_and(known)] if others else []))
        return 0.5 * (least[True] - least[False])

    return [log_odds(*known[j]) for j in which]
