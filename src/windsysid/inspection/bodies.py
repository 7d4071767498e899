"""Body or medium that a channel measures, by its name: structure, blades, water, air or mooring lines.

Known names are the output lists of OpenFAST (ElastoDyn, BeamDyn, AeroDyn, SeaState, HydroDyn, MoorDyn), HAWC2's sensors
with their main bodies and coordinates, Bladed's variables, windsysid's own names, and common words.
"""

import re
from collections.abc import Sequence
from typing import Literal

__all__ = ["Body", "body_of", "name_a_turbine"]

Body = Literal["structure", "rotor", "water", "air", "mooring"]
"""Body or medium of a channel: ``rotor`` for blades, and for hub and shaft in rotating coordinates."""

_OPENFAST: tuple[tuple[Body, str], ...] = (
    ("rotor", r"QD?2?_B\d.*"),  # ElastoDyn: degrees of freedom of blades
    ("rotor", r"(Tip|Spn\d)(D|AL|TD|RD|ML|FL)g?[xyz][bc]\d"),  # TipALxb1, Spn3ALxb1
    ("rotor", r"TipClrnc\d|(OoP|IP|Twst|Roll|Ptch)Defl\d|Root[FM][A-Za-z]{1,5}\d"),  # RootMxc2, RootMEdg1
    ("rotor", r"(LSShft|LSSGag|LSSTip)[FM][yz]a"),  # shaft in rotating coordinates
    ("rotor", r"A?B\d(N\d+|_?Z\d+|Tip|Root|Fld|Aero)\w*"),  # nodes of BeamDyn, ElastoDyn and AeroDyn: B1N001_TAxl
    ("water", r"Wave\d?(Elev|Elv\d|[VA]\w*|DynP)\w*|W\d+[VA][xyz]i"),  # HydroDyn, SeaState: Wave1Elev
    ("water", r"F(Vel|Acc|AccMCF)\d+[xyz]i|FDynP\d+"),  # SeaState: FAcc1xi
    ("water", r"M\d+N\d+(F[VA]|FAMCF)[xyz]i|[MJ]\d+(N\d+)?F?DynP"),  # HydroDyn: M1N1FAxi
    ("water", r"(Hydro|Waves?|Rdtn|HdrStc|Add)[FM]\d?[xyz]i|B\d(Wvs|HdS|Rdt|Add)[FM]\w*"),  # loads of the water
    ("air", r"Wind(Hub)?(\d|Vel|Mag|Acc|Dir)\w*|RtVAvg\w*|TwN\d+[VF]\w*|(Rt|Twr)(Fld|Aero)[FM]\w*"),
    ("mooring", r"L(ine)?\d+N\d+([PVAF][xyz]|T\w*)|(Con(nect)?|Point)\d+[PVAFT]\w*|(Fair|Anch)Ten\d*|T\[\d.*"),
)
"""Patterns of whole names of OpenFAST's channels, in upper or lower case."""

_WORDS: tuple[tuple[Body, str], ...] = (
    ("water", r"\bwaves?\b|\bfluid\b|^(sea|water) level\b"),
    ("water", r"\b(sea|water) (surface|particle|elevation|vel|velocity|acc|acceleration|height|pressure)\b"),
    ("air", r"\bwind (speed|velocity|dir|direction|v[xyz])\b|\bwsp\b|\bfree wind\b|^induc|\bvrel\b|\banemometer\b"),
    ("rotor", r"\bblades?\b|\bbld ?[a-c\d]?\b|\bcoo: *(blade|hub|shaft)(?! ?non)|\brotating hub\b"),
    ("mooring", r"\bmooring\b|\bfairlead\b"),
)
"""Patterns of words in names of other programs and users: HAWC2 ``Mbdy:blade1 … coo: blade1``, Bladed ``Blade 1 …``."""


def body_of(channel: str) -> Body:
    """Body or medium that a channel measures, by its name; ``structure`` if the name matches no other.

    Examples
    --------
    >>> body_of("Spn3ALxb1"), body_of("FAcc1xi"), body_of("YawBrTAxp")
    ('rotor', 'water', 'structure')
    """
    bare = channel.lstrip("-_ ")
    for body, names in _OPENFAST:
        if re.fullmatch(names, bare, re.IGNORECASE):
            return body
    words = _in_words(bare)
    for body, pattern in _WORDS:
        if re.search(pattern, words):
            return body
    return "structure"


def name_a_turbine(channels: Sequence[str]) -> bool:
    """True if the names of channels are those of a wind turbine: some are of its nacelle, rotor, drive train or pitch.

    Examples
    --------
    >>> name_a_turbine(["tower_x_acceleration", "NacAccFA"]), name_a_turbine(["tower_x_acceleration", "floor_2"])
    (True, False)
    """
    return any(body_of(name) == "rotor" or re.search(_TURBINE, _in_words(name)) for name in channels)


_TURBINE = r"\b(nacelle|nac|ncimu|rotor|hub|generator|yaw br|yaw bearing|pitch|power|torque|(gen|rot) (pwr|tq|torq))"
"""Pattern of words of parts and signals of wind turbines, which buildings and bridges rarely have."""


def _in_words(name: str) -> str:
    """Split a name into words in lower case: ``Blade1AccX`` becomes ``blade 1 acc x``."""
    apart = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Za-z])(?=\d)|(?<=\d)(?=[A-Za-z])", " ", name)
    return re.sub(r"[^a-z0-9:]+", " ", apart.lower()).strip()
