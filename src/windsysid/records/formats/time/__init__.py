"""Time columns: units, clocks and series of several rates."""
