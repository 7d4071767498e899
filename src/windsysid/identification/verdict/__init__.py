"""From a fit to a result that can be judged."""
