"""What is read back of a saved result."""

import json
from dataclasses import asdict
from types import SimpleNamespace
from typing import Any

import numpy as np

from windsysid.loads.statistics import Statistic, load_groups, noise_groups, to_logarithms
from windsysid.results.posterior import read_statistics
from windsysid.results.serialization import finite
from windsysid.turbine.turbine import Turbine


def saved(statistics: tuple[Statistic, ...], without: tuple[str, ...] = ()) -> Any:
    """A file with these statistics, some of their fields left out."""
    rows = [{key: value for key, value in asdict(s).items() if key not in without} for s in statistics]
    return SimpleNamespace(attrs={"statistics": json.dumps(finite(rows))})


def test_statistics_of_an_older_version_are_read_by_their_names(verne555: Turbine):
    known = (*load_groups(verne555.loads, verne555.model), *noise_groups(verne555.sensors))
    again = read_statistics(saved(known, without=("kind", "of", "time_constant")))
    assert [s.kind for s in again] == [s.kind for s in known]
    np.testing.assert_array_equal(to_logarithms(again), to_logarithms(known))
    assert [s.of for s in read_statistics(saved(known))] == [s.of for s in known]
