"""The watch over windows: levels, drifts and alarms."""
