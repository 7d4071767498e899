"""Compile what most tests need, once, while types are checked: two workers would compile all of it twice."""

from validation.adversary.scenarios import record as independent_record

import windsysid as ws

independent_record("reference", 1)
for name, duration, rate in (("verne555", 10.0, 50.0), ("tower", 120.0, 10.0), ("nrel5mw_full", 20.0, 25.0)):
    turbine = ws.load_turbine(name)
    record = ws.simulate(turbine, duration=duration, rate=rate, seed=1)
    ws.identify(record, turbine, formulation="joint", loads="broadband")
    ws.oma(record, turbine=turbine)
