"""Many records of many turbines: taken into one archive, watched, and shown on one page (docs/fleet.md)."""
