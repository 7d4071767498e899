"""What several test modules share. Generated models go to the user's own cache, so that a second run is fast."""

import pytest

from windsysid.turbine import Turbine, load_turbine


@pytest.fixture(scope="session")
def verne555() -> Turbine:
    return load_turbine("verne555")
