"""Records that windsysid did not make, to see whether a result that says "trust: yes" covers the true value.

`machine` has equations of motion of its own, `loads` draws forces in continuous time, `instruments` reads the motion as
real loggers do, `scenarios` puts them together, and `campaign` counts. Nothing here uses windsysid's mechanics,
simulation or filters. ``python -m validation.adversary`` prints the table.
"""
