"""121 deliberate faults: sign flips, wrong factors and indices, lost terms, wrong units, steps in time, widths of
priors.

Each changes a number that a user would read. None is equivalent to the code as it is, and none moves a constant that
its specification leaves open.
"""

from typing import NamedTuple

__all__ = ["MUTANTS", "TESTS", "Mutant"]


class Mutant(NamedTuple):
    """One fault: `old` becomes `new` in the source file `module` (its base name); `old` stands there exactly once."""

    name: str
    module: str
    old: str
    new: str
    meaning: str


TESTS: dict[str, tuple[str, ...]] = {
    "rotor.py": ("test_rotor.py", "test_sensors.py", "test_turbine.py", "test_analysis.py"),
    "tower.py": ("test_tower.py",),
    "sensors.py": ("test_sensors.py", "test_compile.py"),
    "equations.py": ("test_rotor.py", "test_compile.py"),
    "generate.py": ("test_compile.py",),
    "compile.py": ("test_compile.py",),
    "gaussian.py": ("test_linear.py", "test_gate.py", "test_protocol.py"),
    "ekf.py": ("test_linear.py", "test_ekf.py", "test_protocol.py"),
    "iekf.py": ("test_iekf.py",),
    "ukf.py": ("test_linear.py", "test_drift.py", "test_ukf.py", "test_protocol.py"),
    "bank_kernel.py": ("test_bank.py", "test_drift.py"),
    "smoother.py": ("test_drift.py", "test_smoother.py", "test_linear.py"),
    "filter.py": ("test_filter.py",),
    "kernels.py": ("test_filter.py",),
    "raoblackwell.py": ("test_filter.py",),
    "estimate/scoring.py": ("test_quadratic.py", "test_posterior_mode.py", "test_bank.py"),
    "windsysid/scoring.py": ("test_scoring.py", "test_quadratic.py", "test_load_choice.py"),
    "estimate/online.py": ("test_quadratic.py", "test_recursive.py"),
    "model/turbine_problem.py": ("test_problem.py",),
    "compose.py": ("test_compose.py", "test_problem.py", "test_drift.py"),
    "step.py": ("test_linear.py", "test_drift.py", "test_ekf.py", "test_bank.py", "test_protocol.py"),
    "process.py": ("test_loads.py", "test_compose.py", "test_simulate.py", "test_hypothesis.py"),
    "rotor_wind.py": ("test_hypothesis.py",),
    "kinematics.py": ("test_rotor.py", "test_sensors.py"),
    "statistics.py": ("test_statistics.py",),
    "estimate/load_selection.py": ("test_load_choice.py",),
    "comparison.py": ("test_comparison.py",),
    "damping.py": ("test_damping.py",),
    "watch.py": ("test_watch.py",),
    "levels/jumps.py": ("test_jumps.py", "test_watch.py"),
    "units.py": ("test_units.py", "test_formats.py"),
    "openfast.py": ("test_formats.py",),
    "clock.py": ("test_clock.py",),
    "access/packed.py": ("test_packed.py",),
    "netcdf.py": ("test_formats.py",),
    "contents/columns.py": ("test_mapping.py", "test_formats.py"),
    "align.py": ("test_align.py",),
    "condition.py": ("test_condition.py",),
    "yaw.py": ("test_condition.py",),
    "integration.py": ("test_integration.py", "test_signals.py"),
    "analysis.py": ("test_analysis.py",),
    "floquet.py": ("test_floquet.py", "test_analysis.py"),
    "campbell.py": ("test_campbell.py",),
    "estimate/force_balance.py": ("test_force_balance.py", "test_diagnosis.py"),
    "planning/formulations.py": ("test_planning.py",),
    "checks/identifiability.py": ("test_directions.py",),
}
"""For each module the test files most likely to notice, the first first; names that do not exist are passed over."""

_MECHANICS = (
    Mutant(
        "air coupling, sideways", "rotor.py",
        "along = vy * cos(theta) - vx * sin(theta) + radius * turning",
        "along = vy * cos(theta) + vx * sin(theta) + radius * turning",
        "air on a blade pushes the hub to the wrong side",
    ),
    Mutant(
        "air coupling, upwards", "rotor.py",
        "along = vy * cos(theta) - vx * sin(theta) + radius * turning",
        "along = -vy * cos(theta) - vx * sin(theta) + radius * turning",
        "air on a blade pushes the hub the wrong way up",
    ),
    Mutant(
        "air coupling, radius", "rotor.py",
        'radius = p["hinge_offset"] + p[f"blade_inertia_{i}"]',
        'radius = p[f"blade_inertia_{i}"]',
        "air on a blade acts on a roll at a radius without the hinge offset",
    ),
    Mutant(
        "roll rate of a blade", "rotor.py",
        "blade_rate = turning + self.rate(beta)",
        "blade_rate = self.omega + self.rate(beta)",
        "a blade does not turn with the roll of the support",
    ),
    Mutant(
        "unbalance", "rotor.py",
        'p["hub_mass_y"] * (vy + p["eccentricity"] * turning * cos(unbalance)) ** 2',
        'p["hub_mass_y"] * (vy - p["eccentricity"] * turning * cos(unbalance)) ** 2',
        "an eccentric hub shakes y with the wrong sign",
    ),
    Mutant(
        "weight of a lagging blade", "rotor.py",
        "weight_moment += S * sin(self.blade_angle(i) + self.lag(i))",
        "weight_moment += S * sin(self.blade_angle(i))",
        "gravity does not pull at a blade's lag",
    ),
    Mutant(
        "inertia of a leaning rotor", "rotor.py",
        "total += self.lean(v) ** 2 * about_hub",
        "total += self.lean(v) * about_hub",
        "the mass that moves with x has the lean once instead of squared",
    ),
    Mutant(
        "parallel axis", "rotor.py",
        'v[f"blade_inertia_{i}"] + 2.0 * d * v[f"blade_first_moment_{i}"]',
        'v[f"blade_inertia_{i}"] + d * v[f"blade_first_moment_{i}"]',
        "half of the coupling term of a blade's inertia about the hub is missing",
    ),
    Mutant(
        "across the blade", "rotor.py",
        "(lever + self.sp.I * across)",
        "(lever - self.sp.I * across)",
        "a sensor beside the blade's axis sits on the other side",
    ),
    Mutant(
        "bending blade", "rotor.py",
        '(self.parameters["hinge_offset"] + (along - lever))',
        '(self.parameters["hinge_offset"] + (lever - along))',
        "a bending blade hinges at the wrong radius",
    ),
    Mutant(
        "tower in a yawing frame", "tower.py",
        "self.rate(x) - self.yaw_rate * z,",
        "self.rate(x) + self.yaw_rate * z,",
        "the frame of the nacelle turns the other way",
    ),
    Mutant(
        "leaning accelerometer", "tower.py",
        "vector = (vector[0] - leaning * x, vector[1] - leaning * z)",
        "vector = (vector[0] + leaning * x, vector[1] + leaning * z)",
        "gravity in a leaning accelerometer has the wrong sign",
    ),
    Mutant(
        "bearing of a sensor", "tower.py",
        "vector[0] * self.sp.sin(turn) - vector[1] * self.sp.cos(turn)",
        "vector[0] * self.sp.sin(turn) + vector[1] * self.sp.cos(turn)",
        "a sensor fixed to the tower reads fore-aft motion with the wrong sign",
    ),
    Mutant(
        "tower damping", "tower.py",
        'dissipation += half * k.parameters[f"c_{name}"]',
        'dissipation += k.parameters[f"c_{name}"]',
        "the tower is damped twice",
    ),
    Mutant(
        "gravity in an accelerometer", "sensors.py",
        'vector += k.sp.I * k.parameters["gravity"]',
        'vector -= k.sp.I * k.parameters["gravity"]',
        "an accelerometer feels gravity the wrong way up",
    ),
    Mutant(
        "frame of a sensor", "sensors.py",
        "k.components(vector * k.turn(-frame_angle))",
        "k.components(vector * k.turn(frame_angle))",
        "a sensor's frame turns against the blade",
    ),
    Mutant(
        "moment in spring and damper", "sensors.py",
        '* q + k.parameters[f"c_{name}"] * k.rate(q)',
        '* q - k.parameters[f"c_{name}"] * k.rate(q)',
        "the damper's part of a measured moment has the wrong sign",
    ),
    Mutant(
        "gyro on a blade", "sensors.py",
        "turning + (k.omega + k.rate(k.lag(sensor.blade)) if sensor.blade else 0)",
        "turning + (k.omega - k.rate(k.lag(sensor.blade)) if sensor.blade else 0)",
        "a gyroscope on a blade reads lag with the wrong sign",
    ),
    Mutant(
        "slope of a bent blade", "sensors.py",
        "k.blade_angle(sensor.blade) + sensor.slope * k.lag(sensor.blade) if",
        "k.blade_angle(sensor.blade) + k.lag(sensor.blade) if",
        "a sensor on a bent blade turns as one on a rigid blade does",
    ),
    Mutant(
        "gain in the kernel's key", "sensors.py",
        'exclude={"channel", "noise", "bias", "drift", "logger", *TOLERANCES}',
        'exclude={"channel", "noise", "bias", "drift", "logger", "gain", *TOLERANCES}',
        "sensors of different gain share one compiled reading",
    ),
    Mutant(
        "Lagrange's dissipation", "equations.py",
        "- derivative(dissipation, rate)",
        "+ derivative(dissipation, rate)",
        "dampers drive",
    ),
    Mutant(
        "rates of the inputs", "equations.py",
        "dict(zip(q, v, strict=True)) | inputs",
        "dict(zip(q, v, strict=True))",
        "momentum does not change with azimuth and rotor speed",
    ),
    Mutant(
        "fill-in of the factorisation", "generate.py",
        'else f"{name} = -{update}"',
        'else f"{name} = {update}"',
        "where elimination couples two degrees of freedom, the coupling has the wrong sign",
    ),
    Mutant(
        "slope of the mass matrix", "generate.py",
        "residual = list(equations.force - equations.mass * sp.Matrix(n, 1, a)) if n else []",
        "residual = list(equations.force) if n else []",
        "Jacobians leave out how the mass matrix moves",
    ),
    Mutant(
        "identified parameters in the kernel's key", "compile.py",
        'asked = ["identified", *identified, ',
        'asked = ["identified", ',
        "models with other identified parameters share one kernel",
    ),
)  # fmt: skip

_FILTERS = (
    Mutant(
        "expected size of an innovation", "gaussian.py",
        "math.sqrt(blocks.noise[c] + inner(ws.H, c, ws.spread, c))",
        "math.sqrt(inner(ws.H, c, ws.spread, c))",
        "the sensor's own noise is left out of the expected innovation",
    ),
    Mutant(
        "determinant in the likelihood", "gaussian.py",
        "math.log(2.0 * math.pi) + z * z) + math.log(root)",
        "math.log(2.0 * math.pi) + z * z) + 0.5 * math.log(root)",
        "log det S is halved once too often",
    ),
    Mutant(
        "second reading of a sample", "gaussian.py",
        "(load(mean, i) - load(ws.about, i))",
        "(load(ws.about, i) - load(mean, i))",
        "a reading is corrected the wrong way for what those before it moved",
    ),
    Mutant(
        "gate on one side", "gaussian.py",
        "inner(ws.H, c, ws.spread, c))\n        gated[c] = abs(innovation[c]) >",
        "inner(ws.H, c, ws.spread, c))\n        gated[c] = innovation[c] >",
        "outliers below are taken in",
    ),
    Mutant(
        "samples of an update", "gaussian.py",
        "belief.samples + (samples if moves else 0)), info, covs",
        "belief.samples + samples), info, covs",
        "an update counts as a step in time",
    ),
    Mutant(
        "inputs before a step", "ekf.py",
        "        before = after\n",
        "        before = previous\n",
        "every step begins with the inputs of the first",
    ),
    Mutant(
        "drifting bias in the bank", "bank_kernel.py",
        "store(P, a, load(P, a) + splat(lanes.walk[s, i]))",
        "store(P, a, load(P, a))",
        "a bias that drifts stays as well known as ever",
    ),
    Mutant(
        "load at the end of a step in the bank", "bank_kernel.py",
        "store(ws.slope_S, c + nw, late * slope)",
        "store(ws.slope_S, c + nw, early * slope)",
        "the load after a step pushes at its beginning",
    ),
    Mutant(
        "azimuth before a step in the bank", "bank_kernel.py",
        "load(ws.top, a) + load(ws.total_S, d) * first)",
        "load(ws.top, a) + load(ws.total_S, d) * last)",
        "a turning load pushes at the beginning of a step from where it is at the end",
    ),
    Mutant(
        "second reading of a sample in the bank", "bank_kernel.py",
        "load(residual, c) + along * load(residual, d)",
        "load(residual, c) - along * load(residual, d)",
        "a residual is corrected the wrong way for readings before it",
    ),
    Mutant(
        "load noise and motion in the bank", "bank_kernel.py",
        "store(P, i * wide + nx + j, load(pushed, i * broad + j))",
        "store(P, i * wide + nx + j, splat(0.0))",
        "the load noise of a step is uncorrelated with the motion it makes",
    ),
    Mutant(
        "inputs within a step in the bank", "bank_kernel.py",
        "ws.u[i] = before[i] + at * (after[i] - before[i])",
        "ws.u[i] = before[i]",
        "the rotor stands still within a step",
    ),
    Mutant(
        "drifting bias in the smoother", "smoother.py",
        "rows[rest + i, n + nz + rough + nx + j] = math.sqrt(blocks.walk[s, i])",
        "rows[rest + i, n + nz + rough + nx + j] = 0.0",
        "a bias that drifts is smoothed as one that stays",
    ),
    Mutant(
        "root of the load noise in the smoother", "smoother.py",
        "ws.gain[i, k] * points.load_roots[s * nz + j, k]",
        "ws.gain[i, k] * points.load_roots[s * nz + k, j]",
        "the root of the load noise is transposed",
    ),
    Mutant(
        "seam of two chunks", "smoother.py",
        "ahead = inputs[chunk.start : chunk.stop + 1]",
        "ahead = inputs[chunk.start : chunk.stop]",
        "the last sample of a chunk knows nothing of the next",
    ),
    Mutant(
        "walk in the unscented filter", "ukf.py",
        "rows[rest + i, n + nz + rough + nx + j] = math.sqrt(blocks.walk[s, i])",
        "rows[rest + i, n + nz + rough + nx + j] = blocks.walk[s, i]",
        "a variance stands where a root belongs",
    ),
    Mutant(
        "second order of a step", "ukf.py",
        "mean[i] = points.first[i] + points.bend[i]",
        "mean[i] = points.first[i]",
        "the mean of a bent step is that of the straight one",
    ),
    Mutant(
        "curvature of a reading", "ukf.py",
        "curved[c, d] += points.curvature[c] * points.curvature[d]",
        "curved[c, d] += 0.0",
        "a bent reading has no noise of its own",
    ),
    Mutant(
        "sides of the load noise", "ukf.py",
        "eta[i] = out * direction[i] if n <= j < n + nz else 0.0",
        "eta[i] = SIGMA_POINT_SIGMAS * direction[i] if n <= j < n + nz else 0.0",
        "both sigma points of a load noise are on one side",
    ),
    Mutant(
        "Gauss-Newton's right side", "iekf.py",
        "readings[c] - ws.y[c] - inner(ws.H, c, towards, 0) if known",
        "readings[c] - ws.y[c] + inner(ws.H, c, towards, 0) if known",
        "the way back to the prediction has the wrong sign",
    ),
    Mutant(
        "noise in the cost", "iekf.py",
        "total += off * off / blocks.noise[c]",
        "total += off * off",
        "readings count in the cost of a step without their noise",
    ),
    Mutant(
        "variance of a Student sensor", "filter.py",
        "1.0 - 2.0 * inverse",
        "1.0 - inverse",
        "a heavy-tailed sensor is said to scatter less than it does",
    ),
    Mutant(
        "peak of a density", "filter.py",
        "student) - 0.5 * np.log(noise))",
        "student) - np.log(noise))",
        "the likelihood counts a sensor's noise twice",
    ),
    Mutant(
        "exponent of a Student density", "kernels.py",
        "power, scale = 0.5 * (nu + 1.0), scale / nu",
        "power, scale = 0.5 * nu, scale / nu",
        "tails are those of another number of degrees of freedom",
    ),
    Mutant(
        "determinant of a particle's filter", "raoblackwell.py",
        "math.log(2.0 * math.pi)) - scores.log_std",
        "math.log(2.0 * math.pi))",
        "a particle is not blamed for a wide prediction",
    ),
)  # fmt: skip

_LIKELIHOOD = (
    Mutant(
        "Fisher information of a scale", "estimate/scoring.py",
        "seen = 2.0 * (moved_s.T @ moved_s)",
        "seen = moved_s.T @ moved_s",
        "what innovations tell by their size counts half",
    ),
    Mutant(
        "slope of an innovation", "estimate/scoring.py",
        "moved_z += middle[:, None] * moved_s",
        "moved_z -= middle[:, None] * moved_s",
        "the derivative of the innovation is that of something else",
    ),
    Mutant(
        "pull of the prior", "windsysid/scoring.py",
        "weight * self.gradient + pull",
        "weight * self.gradient",
        "the search goes to the mode of the likelihood",
    ),
    Mutant(
        "missing readings in the likelihood", "estimate/scoring.py",
        "np.isfinite(readings).sum()",
        "readings.size",
        "readings that are missing count in the likelihood",
    ),
    Mutant(
        "pull of the prior on line", "estimate/online.py",
        "pull = seen.found.gradient - information @ (seen.theta - online.prior_mean)",
        "pull = seen.found.gradient",
        "the last step of an estimate on line forgets the prior",
    ),
    Mutant(
        "slopes of the beliefs on line", "estimate/online.py",
        "slopes = (lanes[..., 1:] - lanes[..., :1]) / online.widths",
        "slopes = 2.0 * (lanes[..., 1:] - lanes[..., :1]) / online.widths",
        "beliefs move twice as far as the parameters ask for",
    ),
    Mutant(
        "samples taken in twice", "estimate/online.py",
        "part = slice(online.samples - held_from, None)",
        "part = slice(0, None)",
        "a block on line takes in samples that are known already",
    ),
    Mutant(
        "first velocity", "model/turbine_problem.py",
        "np.concatenate([amplitude, amplitude * frequency])",
        "np.concatenate([amplitude, amplitude])",
        "the prior of the first velocity is that of a displacement",
    ),
    Mutant(
        "gain of a sensor to motion", "model/turbine_problem.py",
        "to_acceleration = E @ np.linalg.inv(G[n:])",
        "to_acceleration = E @ G[n:]",
        "the prior of the first state is off by the mass squared",
    ),
    Mutant(
        "learned noise", "model/turbine_problem.py",
        "return loads, [sensor.noise for sensor in sensors]",
        "return loads, [sensor.noise for sensor in self.sensors]",
        "the noise that is learned is never used",
    ),
    Mutant(
        "variance of a walk", "compose.py",
        "walk=np.outer(steps,",
        "walk=np.outer(np.square(steps),",
        "a wandering bias gains variance with the square of time",
    ),
    Mutant(
        "prior of a linear parameter", "compose.py",
        "(self.centre / self.scale, self.spread / self.scale)",
        "(self.centre / self.scale, self.spread)",
        "the prior of a damping has its width in other units",
    ),
    Mutant(
        "loads of the first sample", "compose.py",
        "    cov = model.cov[:n, :n].copy()\n    cov[nx : nx + nz, nx : nx + nz] = loads.cov\n",
        "    cov = model.cov[:n, :n].copy()\n",
        "loads begin with the variance of the file instead of that learned",
    ),
    Mutant(
        "drifting bias at given parameters", "compose.py",
        "walk=np.ascontiguousarray(blocks.walk[:, :nb])",
        "walk=np.zeros_like(blocks.walk[:, :nb])",
        "in the likelihood a bias that drifts stays",
    ),
    Mutant(
        "sine of a turning load", "step.py",
        "* cosine + load(rows, 2 * k * vectors + c) * sine",
        "* cosine - load(rows, 2 * k * vectors + c) * sine",
        "a load that turns with the rotor turns backwards",
    ),
    Mutant(
        "load at the end of a step", "step.py",
        "store_part(J, first + nw, late * slope, nw - c)",
        "store_part(J, first + nw, early * slope, nw - c)",
        "the load after a step pushes at its beginning",
    ),
    Mutant(
        "unequal sampling", "step.py",
        "return 0 if blocks.step.size == 1 else int(inputs[inputs.size - 1])",
        "return 0",
        "every step takes the first interval",
    ),
    Mutant(
        "load through the step", "step.py",
        "multiply(direct, gain, 0, nx, 0, nz, ws.phi[s * nz : (s + 1) * nz], direct)",
        "multiply(direct, gain, 0, nx, 0, 0, ws.phi[s * nz : (s + 1) * nz], direct)",
        "a load before a step does not push at its end",
    ),
    Mutant(
        "slope of a logarithmic parameter", "step.py",
        "value = slope = blocks.reference[j] * np.exp(theta)",
        "value = blocks.reference[j] * np.exp(theta)",
        "the slope of a stiffness is that at the prior's centre",
    ),
    Mutant(
        "order of the walks", "step.py",
        "cov[i, i] += walk[i - moving]",
        "cov[i, i] += walk[n - 1 - i]",
        "the last parameter wanders as the first bias should",
    ),
)  # fmt: skip

_LOADS = (
    Mutant(
        "noise of a load", "process.py",
        "-np.expm1(-2.0 * step / self.time_constant)",
        "-np.expm1(-step / self.time_constant)",
        "a load loses its variance from step to step",
    ),
    Mutant(
        "blade forces on the hub", "process.py",
        "0.5j * side * towards * amount",
        "-0.5j * side * towards * amount",
        "forces on blades push the hub to the wrong side",
    ),
    Mutant(
        "blade forces on a roll", "process.py",
        "1.0 + hinge_offset / lever",
        "1.0 - hinge_offset / lever",
        "the hinge offset shortens the lever of a roll",
    ),
    Mutant(
        "sine of a harmonic", "process.py",
        "rows[2 * n] = -c.imag",
        "rows[2 * n] = c.imag",
        "harmonics turn backwards",
    ),
    Mutant(
        "blade forces on a leaning support", "process.py",
        '("load_x", to.kappa)',
        '("load_x", -to.kappa)',
        "forces on blades lean the support the wrong way",
    ),
    Mutant(
        "low-pass in hertz", "process.py",
        "pole = 2.0 * math.pi * CUT_OFF_FACTOR * self.low_pass",
        "pole = CUT_OFF_FACTOR * self.low_pass",
        "a cut-off in Hz is taken for rad/s",
    ),
    Mutant(
        "no rise of levers", "rotor_wind.py",
        'values["load_lever"] * _shape_of(m).lever',
        'values["load_lever"]',
        "small eddies push at the lever of large ones",
    ),
    Mutant(
        "order of a lever", "rotor_wind.py",
        'values["load_lever"] * _shape_of(m).lever',
        'values["load_lever"] * _shape_of(m + 1).lever',
        "the lever of a term is that of the next",
    ),
    Mutant(
        "zero of a term", "rotor_wind.py",
        "[-corner * shape.zero]",
        "[-shape.zero]",
        "the zero of a term does not move with its poles",
    ),
    Mutant(
        "blades that lag", "kinematics.py",
        'own + self.parameters["mean_lag_angle"]',
        'own - self.parameters["mean_lag_angle"]',
        "blades lag by the angle by which they should lead",
    ),
    Mutant(
        "prior of a time constant", "statistics.py",
        'Statistic(name, "s", load.time_constant, spread=LOG_TIME_CONSTANT_STD)',
        'Statistic(name, "s", load.time_constant)',
        "the prior of a load's time constant is as wide as that of its level",
    ),
    Mutant(
        "prior of a level", "statistics.py",
        "LOG_LEVEL_STD, LOG_TIME_CONSTANT_STD = 1.5, 0.7",
        "LOG_LEVEL_STD, LOG_TIME_CONSTANT_STD = 0.5, 0.7",
        "loads and noise may be wrong by a factor of two only",
    ),
    Mutant(
        "level of a load", "statistics.py",
        "matrix[row, names.index(time)] = 0.5",
        "matrix[row, names.index(time)] = -0.5",
        "the level of a spectrum is not what the coordinate holds",
    ),
    Mutant(
        "band of a statistic", "statistics.py",
        "for k in (-2.0, 0.0, 2.0)",
        "for k in (-1.0, 0.0, 1.0)",
        "a band that says two standard deviations is one",
    ),
    Mutant(
        "Occam's factor", "windsysid/scoring.py",
        "+ 0.5 * (sizes[0] - sizes[1])",
        "+ 0.5 * (sizes[1] - sizes[0])",
        "a load model is rewarded for what it leaves open",
    ),
    Mutant(
        "loads that matter", "estimate/load_selection.py",
        "by_loads > NEGLIGIBLE_SHARE**2 * motion",
        "by_loads > NEGLIGIBLE_SHARE * motion",
        "a share of amplitudes is compared with powers",
    ),
)  # fmt: skip

_CHANGES = (
    Mutant(
        "prior of a change of damping", "comparison.py",
        'TYPICAL_CHANGE = {"stiffness": 0.1, "damping": 0.5,',
        'TYPICAL_CHANGE = {"stiffness": 0.1, "damping": 0.1,',
        "a damping is expected to change as little as a stiffness",
    ),
    Mutant(
        "scale of a change of damping", "comparison.py",
        "Parameter(q.name, 0.5 * (a + b), typical * size, False, size)",
        "Parameter(q.name, 0.5 * (a + b), typical, False, size)",
        "the prior of a change of damping is in other units",
    ),
    Mutant(
        "limits of a ratio", "comparison.py",
        "b[0] ** 2 - (SIGMAS * b[1]) ** 2)",
        "b[0] ** 2 + (SIGMAS * b[1]) ** 2)",
        "the limits of a change of damping are off by the error of one of the two",
    ),
    Mutant(
        "prior in the other record's coordinates", "comparison.py",
        "prior_mean = mean + stretch * (known.prior_mean[at] - known.mean[at])",
        "prior_mean = mean - stretch * (known.prior_mean[at] - known.mean[at])",
        "a result's prior lies on the wrong side of it",
    ),
    Mutant(
        "variance at the fit", "damping.py",
        "s = std * np.sqrt(_stretch(fitted, value))",
        "s = std * _stretch(fitted, value)",
        "a ratio of variances scales a standard deviation",
    ),
    Mutant(
        "critical damping", "damping.py",
        "critical=2.0 * frame.turbine.inertia(coordinate) * frequency,",
        "critical=frame.turbine.inertia(coordinate) * frequency,",
        "damping ratios are twice what they should be",
    ),
    Mutant(
        "width of all bands", "damping.py",
        "- 0.5 * square / factor**2",
        "- 0.5 * square / factor",
        "bands grow by the wrong factor where records scatter",
    ),
    Mutant(
        "smallest jump", "watch.py",
        "q * (q + 4.0 * r)",
        "q * (q + r)",
        "the smallest jump that is found is said too small",
    ),
    Mutant(
        "false alarms shared out", "watch.py",
        "threshold(alarms_per_year * step / YEAR / len(followed))",
        "threshold(alarms_per_year * step / YEAR)",
        "each series may alarm as often as all together should",
    ),
    Mutant(
        "ninety days", "levels/jumps.py",
        "MAX_JUMP_AGE_BLOCKS = 12_960",
        "MAX_JUMP_AGE_BLOCKS = 1_296",
        "a jump is forgotten after nine days",
    ),
    Mutant(
        "tolerated jump", "levels/jumps.py",
        "excess = abs(product) - tolerated * energy",
        "excess = abs(product) - tolerated",
        "a tolerated jump is not weighed by what is known of it",
    ),
    Mutant(
        "overshoot of the statistic", "levels/jumps.py",
        "quad(lambda x: x * nu(x) ** 2,",
        "quad(lambda x: x * nu(x),",
        "thresholds are off, and with them the rate of false alarms",
    ),
)  # fmt: skip

_EDGES = (
    Mutant("milli-g", "units.py", '"mg": ("m/s^2", 1e-3 * _G)', '"mg": ("m/s^2", 1e-3)', "a factor of 9.8"),
    Mutant("degrees per second squared", "units.py", '"deg/s^2": ("rad/s^2", _DEGREE)', '"deg/s^2": ("rad/s^2", 1.0)',
    "a factor of 57"),
    Mutant("meganewton metres", "units.py", '"MN*m": ("N*m", 1e6)', '"MN*m": ("N*m", 1e3)', "a factor of 1000"),
    Mutant("damping in kilonewtons", "units.py", '"kN*s/m": ("N*s/m", 1e3)', '"kN*s/m": ("N*s/m", 1e6)',
    "a factor of 1000"),
    Mutant("millibar", "units.py", '"mbar": ("Pa", 100.0)', '"mbar": ("Pa", 1.0)', "a factor of 100"),
    Mutant(
        "sign of a nacelle's sensor", "openfast.py",
        '"NcIMUTAgys": ("nacelle_x_acceleration", 1.0)',
        '"NcIMUTAgys": ("nacelle_x_acceleration", -1.0)',
        "the nacelle's lateral acceleration has the wrong sign",
    ),
    Mutant(
        "azimuth of blade 1", "openfast.py",
        "np.mod(values + 0.5 * np.pi, turn)",
        "np.mod(values - 0.5 * np.pi, turn)",
        "the azimuth is half a turn off",
    ),
    Mutant(
        "epoch of LabVIEW", "clock.py",
        '"labview": (_SECOND, -24_107)',
        '"labview": (_SECOND, -24_106)',
        "a record starts a day late",
    ),
    Mutant(
        "offset of packed numbers", "access/packed.py",
        "(table - self.offset) / self.scale",
        "table / self.scale - self.offset",
        "a packed channel has another mean",
    ),
    Mutant(
        "offset of packed netCDF", "netcdf.py",
        "scale * values + offset",
        "scale * (values + offset)",
        "a packed channel has another mean",
    ),
    Mutant(
        "sign of a mapped channel", "contents/columns.py",
        "to_si(1.0, unit) * rule.scale)",
        "to_si(1.0, unit))",
        "sign and factor of a mapping are forgotten",
    ),
    Mutant(
        "clock drift", "align.py",
        "time + self.offset + self.drift * (time - self.middle)",
        "time + self.offset - self.drift * (time - self.middle)",
        "a clock's drift is doubled instead of taken out",
    ),
    Mutant(
        "tilt of a pair of axes", "condition.py",
        "tilt = float(np.angle(1j / mean))",
        "tilt = float(np.angle(mean / 1j))",
        "a tilted instrument is turned further away",
    ),
    Mutant(
        "downwind axis", "yaw.py",
        "-u1 * cos - u2 * sin",
        "u1 * cos - u2 * sin",
        "downwind motion has a part with the wrong sign",
    ),
    Mutant(
        "acceleration between samples", "integration.py",
        "(acceleration - curvature / 12.0) / scale",
        "(acceleration + curvature / 12.0) / scale",
        "what is lost between samples is lost twice",
    ),
)  # fmt: skip

_MODES = (
    Mutant(
        "slope of a damping ratio", "analysis.py",
        "(-self.slopes.real + (self.exponents.real[:, None] / size) * along) / size",
        "(-self.slopes.real - (self.exponents.real[:, None] / size) * along) / size",
        "the band of a damping ratio has a term with the wrong sign",
    ),
    Mutant(
        "answer to a push", "floquet.py",
        "modal /= (1j * harmonic[:, None] - self.exponents)[:, :, None]",
        "modal /= (1j * harmonic[:, None] + self.exponents)[:, :, None]",
        "the periodic motion answers as if damping drove it",
    ),
    Mutant(
        "speed of a crossing", "campbell.py",
        "spread = SIGMAS * float(std[j]) / slope if",
        "spread = SIGMAS * float(std[j]) if",
        "the band of a resonance speed is in Hz",
    ),
    Mutant(
        "doubt of withheld loads", "estimate/force_balance.py",
        'doubts = (Finding("loads_missing", "reason"),)',
        "doubts = ()",
        "a balance without its loads is trusted",
    ),
    Mutant(
        "ends of a balance", "estimate/force_balance.py",
        "missing[:ends] = missing[-ends:] = True",
        "missing[:ends] = True",
        "the ringing end of a record counts",
    ),
    Mutant(
        "correlated residuals", "estimate/force_balance.py",
        "np.sqrt(rate / (2.0 * (band[1] - band[0])))",
        "np.sqrt(rate / (band[1] - band[0]))",
        "the bands of a balance are wider than they are",
    ),
    Mutant(
        "noise of a thinned record", "planning/formulations.py",
        "factor * s.noise",
        "s.noise",
        "a plan for a fast record sees each of the few samples that it simulates as noisy as one of all",
    ),
    Mutant(
        "ratio that is seen", "checks/identifiability.py",
        "seen = np.array([row[1], -row[0]])",
        "seen = np.array([row[1], row[0]])",
        "the band of a ratio is that of a product",
    ),
)  # fmt: skip

MUTANTS: tuple[Mutant, ...] = (*_EDGES, *_LOADS, *_CHANGES, *_MODES, *_MECHANICS, *_LIKELIHOOD, *_FILTERS)
"""All of them, by subject."""
