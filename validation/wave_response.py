"""Fore-aft frequency of an operating turbine from its response to measured waves.

``python -m validation.wave_response --openfast FOLDER`` fits the transfer function from wave elevation to the fore-aft
moment at the tower base, for OpenFAST's records of the IEA 15 MW turbine on a monopile. Waves are a load that the rotor
does not change: unlike the spectrum of the wind's loads, their shape need not be assumed. The result is the mode with
the rotor in the air, compared with the program's linearisation without air.
"""

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from validation.field import markdown
from validation.windows import END, RECORDS, START
from windsysid.records.formats import read_record

__all__ = ["main", "response"]

Array = NDArray[np.float64]

BAND = (0.11, 0.24)
"""Setting: frequencies [Hz] between the waves' peak and 2P."""

DAMPING, SPREAD = 0.06, (0.1, 0.7)
"""Setting: prior mean of the damping ratio; prior standard deviations of the logarithms of frequency and damping."""

NOISE_BINS, ITERATIONS = 8.0, 8
"""Setting: standard deviation, in bins, of the smoothing of the noise spectrum, and fits with that of the last one."""

HANN_OVERLAP = 35.0 / 18.0
"""Numerical: variance of a mean of neighbouring bins under a Hann taper over that of independent ones."""


def response(waves: Array, moment: Array, rate: float, reference: float) -> tuple[float, float, float, float]:
    """Shift of the frequency and damping ratio, each with its standard deviation.

    The transfer function is (a + b(f − f₀)/f₀) / (f₁² − f² + 2iζf₁f) with complex a and b; the noise has any smooth
    spectrum.
    """
    taper = np.hanning(len(waves))
    f = np.fft.rfftfreq(len(waves), 1.0 / rate)
    used = (f > BAND[0]) & (f < BAND[1])
    U, Y = (np.fft.rfft(taper * (one - one.mean()))[used] for one in (waves, moment))
    f, U, Y = f[used], U / np.sqrt(np.mean(abs(U) ** 2)), Y / np.sqrt(np.mean(abs(Y) ** 2))
    reach = int(4 * NOISE_BINS)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / NOISE_BINS) ** 2)

    def left(p: Array) -> Array:
        middle, ratio = reference * math.exp(p[4]), DAMPING * math.exp(p[5])
        gain = complex(p[0], p[1]) + complex(p[2], p[3]) * (f / reference - 1.0)
        return np.asarray(Y - gain * middle**2 / (middle**2 - f**2 + 2j * ratio * middle * f) * U)

    def weighted(p: Array, noise: Array) -> Array:
        z = left(p) * np.sqrt(2.0 / HANN_OVERLAP / noise)
        return np.concatenate([z.real, z.imag, p[4:] / SPREAD])

    found = None
    for start in (-0.05, 0.0, 0.05):
        p, noise = np.array([0.05, 0.0, 0.0, 0.0, start, 0.0]), np.ones(len(f))
        for _ in range(ITERATIONS):
            fit = least_squares(weighted, p, args=(noise,))
            p, square = fit.x, np.pad(abs(left(fit.x)) ** 2, reach, mode="reflect")
            noise = np.convolve(square, kernel / kernel.sum(), mode="valid")
        cost = float(np.sum(np.log(noise)) / HANN_OVERLAP + 0.5 * np.sum((p[4:] / SPREAD) ** 2))
        if found is None or cost < found[0]:
            slopes = np.asarray(fit.jac)
            found = cost, p, np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)))
    assert found is not None
    _, p, std = found
    ratio = DAMPING * math.exp(p[5])
    return math.expm1(p[4]), float(std[4]), ratio, ratio * float(std[5])


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table, and the mean of the operating turbines by inverse variance."""
    parser = argparse.ArgumentParser(prog="python -m validation.wave_response", description=__doc__.splitlines()[0])
    parser.add_argument("--openfast", type=Path, required=True, help="folder of the records (*.outb)")
    folder, rows, operating = parser.parse_args(arguments).openfast, [], []
    for name in ("m1", "m2", "k06", "k08", "k12", "k16", "k20", "k24", "p08", "p20"):
        record = read_record(folder / f"{RECORDS[name].file}.outb").section(START, END["sea"])
        waves, moment = record["wave_elevation"], record["TwrBsMyt"]
        shift, std, ratio, ratio_std = response(waves, moment, record.rate, RECORDS[name].fore_aft)
        rows.append((name, f"{shift:+.1%} ± {std:.1%}", f"{ratio:.1%} ± {ratio_std:.1%}"))
        operating += [(shift, std)] if name[0] != "p" else []
    print(markdown(("record", "frequency over that without air", "damping ratio"), rows))
    shifts, stds = np.array(operating).T
    weights = stds**-2.0 / np.sum(stds**-2.0)
    print(f"\noperating: {weights @ shifts:+.1%} ± {np.sum(stds**-2.0) ** -0.5:.1%}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
