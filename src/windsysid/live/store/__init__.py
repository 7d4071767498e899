"""Store of the live service: SQLite or PostgreSQL (docs/live_store.md)."""

from windsysid.live.store.keep import Keep
from windsysid.live.store.opening import open_store
from windsysid.live.store.store import Store

__all__ = ["Keep", "Store", "open_store"]
