"""Many turbines followed while they run: blocks of samples in, estimates with bands and alarms out, nothing lost."""
