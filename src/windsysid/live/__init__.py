"""Many turbines followed while they run: blocks of samples in, estimates with intervals and alarms out, nothing
lost."""
