"""Sentences about spectra."""

from windsysid.results.sentences import sentence
from windsysid.results.sentences.spectra import SPECTRA


def test_ranges_and_modes_are_listed_in_hertz():
    ranges = sentence("ranges_read", {"ranges": [[0.2, 0.7], [1.0, 2.5]]})
    assert ranges == "fitted at 0.2 … 0.7 Hz, 1 … 2.5 Hz; rotor harmonics removed"
    bands = sentence("bands_read", {"modes": {"tower x": 0.331, "lag": 0.7}})
    assert (
        bands == "frequency ranges around modes: tower x near 0.331 Hz, lag near 0.7 Hz; rotor harmonics were removed"
    )


def test_the_lag_angle_has_twice_its_standard_deviation_in_milliradians():
    expected = "the blades' mean lag angle is 12.3 ± 4.0 mrad"
    assert sentence("lag_angle", {"angle": 0.0123, "std": 0.002}) == expected


def test_one_block_is_no_blocks():
    data = {"duration": 600.0, "low": 0.1, "high": 0.5}
    assert sentence("blocks_read", data | {"blocks": 1}).startswith("read in 1 block of 600 s")
    assert sentence("blocks_read", data | {"blocks": 3}).startswith("read in 3 blocks of 600 s")


def test_peaks_are_named_by_their_modes():
    data = {"modes": ["tower x", "tower y"], "frequencies": [0.33, 0.36], "others": [0.4]}
    assert sentence("ambiguous_peak", data).startswith(
        "tower x and tower y may be the peak at 0.33, 0.36 Hz or that at 0.4"
    )
    assert sentence("halves_disagree_in_bands", {"change": -0.034, "chance": 0.9}, ("k_x",)).startswith(
        "the halves of the record differ in k_x (-3.4 %, probability 90 %)"
    )
    assert all(not isinstance(one, tuple) for one in SPECTRA.values())  # none has a cause that may be known otherwise
