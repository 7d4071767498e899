import pytest

from windsysid.inspection.bodies import body_of, name_a_turbine

NAMES = {
    "rotor": [
        "Spn1ALxb1", "Spn3ALgyb2", "-TipALxb1", "TipDxc1", "TipDyb3", "TipRDyb1", "OoPDefl1", "IPDefl2",
        "RootMxc1", "RootMEdg1", "RootMFlp3", "Q_B1F1", "QD2_B2E1", "B1N001_TAxl", "B1N003ALx", "B2TipTAXr",
        "B1RootMxr", "AB1N001Fx", "B3_Z012300_ALx", "LSSTipMya", "blade_1_tip_lag_acceleration", "Blade1AccX",
        "blade-a edge acc", "Bld2_acc", "Blade 1 x-acceleration", "Rotating hub Mx", "Mx coo: blade1",
        "State acc x State acc x Mbdy:blade2 E-nr: 19 Z-rel:1.00 coo: global", "Fx coo: shaft",
    ],
    "water": [
        "Wave1Elev", "Wave2Elv1", "WaveElev", "Wave1Vxi", "Wave1Axi", "Wave1AccX", "W1Axi", "FAcc1xi",
        "FVel9zi", "FAccMCF3yi", "FDynP2", "M1N1FAxi", "M9N9FVzi", "M1N2DynP", "HydroFxi", "B1WvsF1xi",
        "wave_elevation", "Water surface gl. coo", "Water acc., x-dir, at gl. coo", "sea surface elevation",
        "Water particle acceleration in X direction",
    ],
    "air": [
        "Wind1VelX", "WindHubVelX", "RtVAvgxh", "RtAeroFxh", "WSP gl. coo.,Vx", "Free wind speed Vy",
        "Induc. Vz, rpco",
    ],
    "mooring": [
        "L1N4Ax", "Line2N1PZ", "FAIRTEN1", "ANCHTEN2", "Con3Ax", "mooring_line_1_tension",
    ],
    "structure": [
        "YawBrTAxp", "YawBrTAgyp", "NcIMUTAxs", "TwHt1ALxt", "PtfmTAxi", "PtfmSurge", "B1TAxi", "M1N1TAxe",
        "IntfTAXss", "-ReactFXss", "TTDspFA", "Q_TFA1", "QD2_TSS1", "LSSTipMys", "RotThrust",
        "tower_x_acceleration", "acceleration_1", "floor_3", "ch1", "A1", "bridge deck mid acc", "root_strain",
        "tip_acc1", "ip_camera_2", "anchor_bolt_3_strain", "building 1 floor 2",
        "Nacelle fore-aft acceleration", "Tower Mx at 12.5", "Stationary hub Fx", "Mx coo: tower",
        "Fx coo: shaft_nonrotate", "State acc x Mbdy:tower E-nr: 9 Z-rel:1.00 coo: tower",
        "tower_waterline_acceleration", "WindTurbine1TowerAcc",
    ],
}  # fmt: skip


@pytest.mark.parametrize(("body", "name"), [(body, name) for body, names in NAMES.items() for name in names])
def test_a_name_tells_the_body_that_a_channel_reads(body, name):
    assert body_of(name) == body


@pytest.mark.parametrize("channel", ["electric_power_W", "pitch_deg", "BldPitch1", "GenPwr", "RotTorq"])
def test_a_signal_of_the_drive_train_or_the_pitch_names_a_turbine(channel):
    """Björkö's record without its speed has power and pitch only: 1P and 2P had grade A."""
    assert name_a_turbine(["time_s", channel])


def test_names_of_buildings_and_bridges_name_no_turbine():
    assert not any(name_a_turbine([name]) for name in ("floor_2", "general_1", "deck_mid_acc", "tower_x_acceleration"))
