"""What several test modules share. Generated models go to the user's own cache, so that a second run is fast."""

import pytest

from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine


@pytest.fixture(scope="session")
def verne555() -> Turbine:
    return load_turbine("verne555")
