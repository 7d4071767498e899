"""Interactive plots of report pages, with a static SVG of each for print and for browsers without JavaScript."""
