"""Which formulation answers where nobody says how, and what one of them hears of another."""

import math

import numpy as np

from windsysid.errors import WindsysidError
from windsysid.identification.condition.readings import usable_sensors
from windsysid.identification.effects.random_walk_bias import with_drifting_offsets
from windsysid.identification.formulations import DISAGREEMENT, by_filters, by_spectra, disagreement, jointly
from windsysid.identification.job import Asked, Found
from windsysid.identification.model.fit import Outcome, compare
from windsysid.identification.verdict.conclude import doubts_of_innovations
from windsysid.loads.family import Broadband
from windsysid.loads.narrow_band import NarrowBand
from windsysid.loads.rotor_wind import RotorWind
from windsysid.spectral.rotor_bands.build import is_lightly_damped

__all__ = ["by_spectra_alone", "by_what_fits"]

BEGINNING = 60.0
"""Periods of the slowest mode at a record's beginning in which filters look for loads that they cannot explain: where
there are, a search of all of it takes minutes."""

WITHOUT_WIND = "broad loads explain the record, and spectra in bands suppose wind: use --formulation joint"


def by_what_fits(asked: Asked) -> Found:
    """By spectra under wind and where nothing turns, jointly otherwise; the other way is asked, too, but under wind.

    Springs that harden, friction, play and loads of another kind show in innovations; in the size of a spectrum they
    hardly do.
    """
    try:
        spectral = asked.spectra or by_spectra(asked)
    except (WindsysidError, np.linalg.LinAlgError) as error:
        return by_filters(asked).saying(f"joint formulation, as spectra do not apply ({error})")
    doubts = (*spectral.outcome.doubts, *_undamped(spectral.outcome))
    if not doubts and spectral.outcome.hypothesis == RotorWind.name:
        broad = _by_broad_loads(asked) if spectral.outcome.in_bands else None
        if broad is not None:
            return broad.saying("joint formulation: broad loads explain the record, and spectra in bands suppose wind")
        return spectral.saying("spectral formulation: wind drives a turning rotor, and the record is stationary")
    if not doubts and spectral.drifts:
        return spectral.saying("spectral formulation: a clock drifts, and filters feel what is read between samples")
    again = asked._replace(prior=spectral.prior, drifts=spectral.drifts)
    if spectral.drifts and asked.loads == "auto":
        again = again._replace(loads=Broadband.name)  # others would explain what filters feel of that
    joint = by_filters(again) if doubts else _held_against(spectral.outcome, again)
    joint = joint._replace(outcome=joint.outcome._replace(given_priors=spectral.outcome.given_priors))
    if doubts:
        explained = joint.narrow or joint.outcome.hypothesis == NarrowBand.name
        if not explained and compare(joint.outcome, spectral.outcome)[1] < DISAGREEMENT:
            joint = joint.beside(*spectral.narrow)  # filters have ended where spectra did
        return joint.saying(f"joint formulation, as spectra are in doubt ({doubts[0]})")
    name, off = compare(joint.outcome, spectral.outcome)
    against = [disagreement(name, off, joint, asked.turbine)]
    if spectral.outcome.turns:
        if off > DISAGREEMENT:
            return joint.saying("joint formulation; spectra were asked, too", *against)
        return joint.saying(f"joint formulation; spectra agree within {off:.1f} standard deviations")
    why = "spectral formulation: the record is stationary, and nothing that moves turns"
    if off > DISAGREEMENT:
        return spectral.saying(f"{why}; filters were asked, too", *against)
    innovations = doubts_of_innovations(joint.outcome, joint.read.rate)
    return spectral.saying(f"{why}; filters agree within {off:.1f} standard deviations", *innovations)


def by_spectra_alone(asked: Asked) -> Found:
    """By spectra; a rotor that is read in bands, which suppose wind, is held against filters that do without."""
    found = by_spectra(asked)
    if found.outcome.doubts or not found.outcome.in_bands or _by_broad_loads(asked) is None:
        return found
    return found.doubted(WITHOUT_WIND)


def _held_against(spectral: Outcome, asked: Asked) -> Found:
    """What filters say beside spectra. Where that differs, and a drift of sensors that feel gravity is there and
    explains it, what they say with that drift."""
    joint = jointly(asked, spectral)
    if compare(joint.outcome, spectral)[1] <= DISAGREEMENT:
        return joint
    part = asked.part.on_own_times()
    sensors = usable_sensors(part, asked.turbine, asked.sensors)
    if not with_drifting_offsets(part, asked.turbine, sensors, leaning=True)[2]:
        return joint
    drifting = jointly(asked._replace(leaning=True), spectral)
    agrees = compare(drifting.outcome, spectral)[1] <= DISAGREEMENT
    return drifting if agrees and not doubts_of_innovations(drifting.outcome, drifting.read.rate) else joint


def _by_broad_loads(asked: Asked) -> Found | None:
    """By filters under broad loads, where these explain the record of a rotor whose modes are well damped, which bands
    take for one in wind; None where they do not, or other loads are asked for. A real machine's modes are lightly
    damped, and it has more than its model: it stays with bands."""
    if asked.loads not in ("auto", Broadband.name) or is_lightly_damped(asked.turbine):
        return None
    part, joint = asked.part, None
    begun = float(part.time[0])
    beginning = begun + BEGINNING * 2.0 * math.pi / asked.turbine.slowest_frequency
    for end in sorted({min(beginning, float(part.time[-1])), float(part.time[-1])}):
        try:
            joint = jointly(asked._replace(part=part.section(begun, end), loads=Broadband.name))
        except (WindsysidError, np.linalg.LinAlgError):
            return None
        if joint.outcome.doubts or doubts_of_innovations(joint.outcome, joint.read.rate):
            return None
    return joint


def _undamped(found: Outcome) -> list[str]:
    """Which damping is not positive: a spectrum says its size only, and a search may end at the mirror image."""
    at = zip(found.model.parameters, found.theta.tolist(), strict=True)
    dampers = [(q, theta) for q, theta in at if q.kind == "damping" and q.part in found.turbine.model.coordinates]
    return [f"{q.name} is not positive" for q, theta in dampers if q.physical(theta) <= 0.0]
