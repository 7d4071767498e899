import pytest

pytest.importorskip("fastapi", reason="the page needs the extra live")

from windsysid.live.page.app import app
from windsysid.live.store import open_store

from . import sample


@pytest.fixture(scope="session")
def store():
    """Half a day of three turbines; tests acknowledge, but take nothing away."""
    filled = open_store(":memory:")
    sample.fill(filled, days=0.5)
    yield filled
    filled.close()


@pytest.fixture
def page(store):
    return app(store)
