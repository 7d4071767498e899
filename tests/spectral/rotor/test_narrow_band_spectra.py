"""Spectra of a narrow-band load against the process that filters take, and their slopes against differences."""

import numpy as np
import pytest
from scipy.integrate import quad

from windsysid.loads.narrow_band import FREQUENCY, WIDTH, NarrowBand, narrow_band_statistics
from windsysid.spectral.rotor.load_spectra import BroadbandLoads, slopes_by_differences
from windsysid.spectral.rotor.narrow_band_spectra import NarrowBandBeside, narrow_density
from windsysid.statespace.process import second_order
from windsysid.turbine.turbine import Turbine


@pytest.mark.parametrize("damping", [0.003, 0.05])
def test_the_density_is_that_of_white_noise_through_a_second_order_low_pass(damping: float):
    near = [0.33, 0.33 * (1.0 - 3.0 * damping), 0.33 * (1.0 + 3.0 * damping)]
    power = (
        2.0 * quad(lambda f: float(narrow_density(np.array(f), 0.33, damping)[0]), 0.0, 50.0, points=near, limit=500)[0]
    )
    assert power == pytest.approx(1.0, rel=1e-4)
    f = np.array([0.01, 0.2, 0.33, 0.335, 2.0])
    ratio = narrow_density(f, 0.33, damping)[0] / second_order(1.0, 0.33, damping).spectrum(f)
    assert ratio == pytest.approx(np.full(5, ratio[0]), rel=1e-9)  # of one spectrum per rad/s, the other per Hz


def beside(turbine: Turbine) -> NarrowBandBeside:
    frequency = np.linspace(0.02, 0.6, 30)[:, None] + 1.16 * np.arange(-5, 6)
    narrow = narrow_band_statistics(turbine, turbine.loads)
    broad = BroadbandLoads(turbine.loads, turbine.model, frequency)
    return NarrowBandBeside(broad, narrow, turbine.model, list(turbine.model.loads), frequency)


def test_slopes_are_those_of_differences(verne555: Turbine):
    sources = beside(verne555)
    values = {one.name: 1.2 * one.given for one in sources.statistics} | {WIDTH: 0.05}
    exact, differences = sources.slopes(values, 2), slopes_by_differences(sources, values, 2)
    for ours, theirs in zip(exact.own, differences.own, strict=True):
        assert ours == pytest.approx(theirs, abs=1e-5 * np.abs(theirs).max())


def test_it_adds_to_the_loads_on_the_support_and_to_no_other(verne555: Turbine):
    sources = beside(verne555)
    values = {one.name: one.given for one in sources.statistics}
    more = sources.spectra(values).own - sources._broad.spectra(values).own
    pushed = np.abs(sources.placement) @ (more.max(axis=0) > 0.0)
    names = np.tile(list(verne555.model.loads), 11)
    assert set(names[pushed > 0.0]) == {"load_x", "load_y"}


def test_filters_and_spectra_know_the_same_load(verne555: Turbine):
    supposed = NarrowBand().suppose(verne555, verne555.loads)
    values = {s.name: s.given for s in supposed.statistics} | {FREQUENCY: 1.7, "narrow_band_rms_x": 3.0}
    of_x = [block for block in supposed.blocks(values) if "load_x" in block.outputs]
    assert [len(block.states) for block in of_x] == [1, 2]
    row = of_x[1].outputs["load_x"][0]
    assert row @ of_x[1].cov @ row == pytest.approx(9.0)
