"""A mapping is proposed from tags, words, gravity and ranges; what is not known stays a question."""

import numpy as np
import pandas as pd
import pytest

from tests.records.formats.helpers import write
from windsysid.errors import ConfigurationError, RecordError
from windsysid.inspection.proposal import propose_mapping
from windsysid.inspection.tags import meaning_of
from windsysid.records.formats import load_mapping, read_record
from windsysid.records.formats.contents.mapping import Mapping, TimeRule

G = 9.80665
TIME = 0.02 * np.arange(3000)
SPEED = 1.267


def mast(folder, seed=0, **more):
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal
    columns = {
        "time [s]": TIME,
        "WROT_RotSpd": SPEED * 30.0 / np.pi + 0.05 * np.sin(0.1 * TIME),
        "WROT_BlPthAngVal2": 3.0 + 0.5 * np.sin(0.02 * TIME),
        "Acc_X_nacelle": 30.0 * np.sin(2.0 * np.pi * 0.32 * TIME) + noise(TIME.size),
        "TowerTop_AccZ": 1000.0 + 2.0 * noise(TIME.size),
        "Blade2 edge acc": np.cos(SPEED * TIME) + 0.05 * noise(TIME.size),
        "column_3": 1.001 + 0.01 * noise(TIME.size),
        "strain_A [microstrain]": 200.0 + noise(TIME.size),
        "status": np.ones(TIME.size),
        **more,
    }
    path = folder / "mast.csv"
    pd.DataFrame(columns).to_csv(path, index=False)
    return path


def said(name):
    meaning = meaning_of(name)
    assert meaning is not None
    return meaning


def guesses(path, **options):
    return {guess.written: guess for guess in propose_mapping(path, **options).guesses}


@pytest.mark.parametrize(
    ("tag", "name"),
    [
        ("WTUR_W", "power"), ("WTUR1.W", "power"), ("WMET_HorWdSpd", "wind_speed"),
        ("WTG07.WMET1.HorWdSpd.mag.f", "wind_speed"), ("WMET_HorWdSpd_Avg", "wind_speed"),
        ("WMET_HorWdSpd_Sdv", "wind_speed_std"), ("WROT_BlPthAngVal", "blade_1_pitch"),
        ("WROT_BlPthAngVal3", "blade_3_pitch"), ("WROT_BlPthAngVal_2_Max", "blade_2_pitch_max"),
        ("WROT.RotSpd", "rotor_speed"), ("WROT/RotPos", "rotor_azimuth"), ("WNAC_Dir", "nacelle_yaw"),
        ("Rotor Speed", "rotor_speed"), ("RotorSpeed", "rotor_speed"), ("WindSpeed_Mast80", "wind_speed"),
        ("NacAccFA", "nacelle_z_acceleration"), ("tower top side-side acceleration", "tower_x_acceleration"),
    ],
)  # fmt: skip
def test_tags_of_iec_61400_25_and_usual_words_are_known(tag, name):
    assert said(tag).name == name


@pytest.mark.parametrize(
    ("written", "name"),
    [
        ("Beschleunigung Turm längs", "tower_z_acceleration"), ("Beschleunigung_vorn", "tower_z_acceleration"),
        ("Turmkopfbeschleunigung quer", "tower_x_acceleration"), ("Beschl. Gondel seitlich", "nacelle_x_acceleration"),
        ("Aceleración torre longitudinal", "tower_z_acceleration"), ("Windgeschwindigkeit", "wind_speed"),
        ("Aceleracio\u0301n góndola lateral", "nacelle_x_acceleration"), ("Velocidad viento", "wind_speed"),
        ("Velocidad del rotor", "rotor_speed"), ("Vitesse rotor", "rotor_speed"), ("Drehzahl", "rotor_speed"),
        ("Generatordrehzahl", "generator_speed"), ("Turbulenz", None),
    ],
)  # fmt: skip
def test_names_in_german_spanish_and_french_are_known(written, name):
    meaning = meaning_of(written)
    assert (meaning.name if meaning else None) == name


@pytest.mark.parametrize("name", ["channel 7", "WROTTEN", "temp", "gain", "foreign"])
def test_other_names_say_nothing(name):
    assert meaning_of(name) is None


@pytest.mark.parametrize(
    "name", ["tower_x_acceleration", "tower_z_acceleration", "blade_1_lag_acceleration", "nacelle_z_displacement"]
)
def test_a_name_as_windsysid_has_them_stays(name):
    meaning = meaning_of(name)
    assert meaning is not None
    assert (meaning.name, meaning.doubts) == (name, ())


def test_a_tag_that_is_not_used_says_so_and_a_missing_number_is_a_doubt():
    assert said("WNAC_Foo").name is None
    assert "of which blade" in said("WROT_BlPthAngVal").doubts[0]


def test_gravity_tells_the_unit_of_upright_and_of_turning_accelerometers(tmp_path):
    found = guesses(mast(tmp_path))
    assert found["TowerTop_AccZ"].unit == "mg"
    assert found["Blade2 edge acc"].unit == "g"
    assert found["Blade2 edge acc"].name == "blade_2_tip_lag_acceleration"
    assert any("1P" in text for text in found["Blade2 edge acc"].evidence)
    assert any("0.317 Hz" in text or "0.32" in text for text in found["Acc_X_nacelle"].evidence)


def test_what_cannot_be_told_is_a_question_and_no_line(tmp_path):
    found = guesses(mast(tmp_path))
    assert found["WROT_BlPthAngVal2"].unit is None  # 3.5 may be rad or deg
    assert found["Acc_X_nacelle"].unit is None
    assert found["column_3"].name is None
    assert "is it an accelerometer in g?" in found["column_3"].doubts
    assert not any("accelerometer" in doubt for doubt in found["status"].doubts)
    text = propose_mapping(mast(tmp_path)).to_toml()
    assert '# [channels."column_3"]' in text
    assert text.count("# ? unit = ") == 4


def test_the_proposal_is_a_mapping_that_refuses_what_nobody_decided(tmp_path):
    path, target = mast(tmp_path), tmp_path / "m.toml"
    target.write_text(propose_mapping(path).to_toml(), encoding="utf-8")
    with pytest.raises(RecordError, match="'blade_2_pitch' has no unit"):
        read_record(path, mapping=target)
    text = target.read_text(encoding="utf-8")
    for name, unit in (("blade_2_pitch", "deg"), ("nacelle_x_acceleration", "mg")):
        text = text.replace(f'name = "{name}"\n# ? unit = ', f'name = "{name}"\nunit = "{unit}"')
    assert '# ? name = "nacelle_x_acceleration"' in text  # its axis is a guess
    text = text.replace('# ? name = "', 'name = "')
    target.write_text(text, encoding="utf-8")
    record = read_record(path, mapping=target)
    assert record.channels == (
        "rotor_speed", "blade_2_pitch", "nacelle_x_acceleration", "tower_y_acceleration",
        "blade_2_tip_lag_acceleration", "strain_A",
    )  # fmt: skip
    assert np.mean(record["tower_y_acceleration"]) == pytest.approx(G, rel=1e-3)
    assert np.mean(record["rotor_speed"]) == pytest.approx(SPEED, rel=1e-2)


def test_a_unit_that_gravity_contradicts_is_a_doubt(tmp_path):
    more = {"hub vertical acc [m/s^2]": 1.0 + 0.01 * np.sin(TIME)}
    found = guesses(mast(tmp_path, **more))["hub vertical acc"]
    assert "the file says m/s^2, gravity says g" in found.doubts


def test_two_channels_that_look_alike_keep_their_own_names(tmp_path):
    found = guesses(mast(tmp_path, WTRM_RotSpd=12.1 + 0.01 * np.sin(TIME)))
    assert found["WROT_RotSpd"].name is None
    assert any("several channels look like rotor_speed" in doubt for doubt in found["WTRM_RotSpd"].doubts)


def test_what_was_known_of_time_and_text_is_kept(tmp_path):
    path = write(tmp_path, "".join(f"{k % 7},{k % 3}\n" for k in range(300)))
    given = Mapping(time=TimeRule(rate=50.0, start="2021-07-07T12:00:00"))
    target = tmp_path / "m.toml"
    target.write_text(propose_mapping(path, given).to_toml(), encoding="utf-8")
    assert load_mapping(target).time == given.time


def test_columns_of_text_are_left_out_and_said(tmp_path):
    path = mast(tmp_path, **{"turbine name": ["T 07"] * TIME.size, "remark": ["run"] * (TIME.size - 1) + ["stop"]})
    found = propose_mapping(path)
    assert {"turbine name", "remark"}.isdisjoint(guess.written for guess in found.guesses)
    assert "Left out, because they hold text: turbine name, remark." in found.remarks
    target = tmp_path / "m.toml"
    target.write_text(found.to_toml(), encoding="utf-8")
    assert load_mapping(target).only_listed


def test_the_mapping_of_openfast_output_changes_nothing_until_a_line_is_needed(tmp_path):
    from tests.records.formats.test_formats import outb

    rows = np.cumsum(np.ones((40, 4)), axis=0)
    names = ["NcIMUTAys", "TwrBsMyt", "Azimuth", "TipALyb1"]
    path = write(tmp_path, outb(rows, names, ["(m/s^2)", "(kN-m)", "(deg)", "(m/s^2)"]), "x.outb")
    found = propose_mapping(path)
    assert {guess.written: (guess.name, guess.unit) for guess in found.guesses} == {
        "NcIMUTAys": ("nacelle_x_acceleration_kinematic", "m/s^2"), "TwrBsMyt": ("TwrBsMyt", "kN*m"),
    }  # fmt: skip
    text = found.to_toml()
    unchanged = read_record(path, mapping=load_mapping(write(tmp_path, text, "m.toml")))
    assert unchanged.channels == read_record(path).channels
    for line in (
        '[channels."NcIMUTAys"]',
        '[channels."TwrBsMyt"]',
        'unit = "m/s^2"',
        'unit = "kN*m"',
        'name = "TwrBsMyt"',
    ):
        text = text.replace(f"# {line}", line)
    text = text.replace('# name = "nacelle_x_acceleration_kinematic"', 'name = "tower_x_acceleration"')
    record = read_record(path, mapping=load_mapping(write(tmp_path, text, "m.toml")))
    assert record.channels == (
        "tower_x_acceleration", "TwrBsMyt", "rotor_azimuth", "blade_1_tip_lag_acceleration_kinematic",
    )  # fmt: skip
    np.testing.assert_array_equal(record["TwrBsMyt"], read_record(path)["TwrBsMyt"])


def test_a_mapping_that_lists_no_channel_says_so(tmp_path):
    rules = load_mapping(write(tmp_path, "only_listed = true\n", "m.toml"))
    with pytest.raises(ConfigurationError, match="lists no channel of the record"):
        read_record(mast(tmp_path), mapping=rules)


def test_the_command_writes_the_mapping_and_replaces_none(tmp_path, run):
    path, target = mast(tmp_path), tmp_path / "new" / "m.toml"
    ended = run("inspect", path, "--write-mapping", target)
    assert ended.code == 0
    assert "rotor_speed" in ended.out
    assert load_mapping(target).only_listed
    again = run("inspect", path, "--write-mapping", target)
    assert again.code == 2
    assert "m.toml" in again.err[0]


def test_a_matlab_file_with_constants_beside_its_signals_gets_a_mapping_that_reads_it(tmp_path):
    from scipy.io import savemat

    signals = np.random.default_rng(0).standard_normal((5, 3000))
    constants = {"wn": np.array([[1.2, 3.4]]), "posSensors": np.arange(5.0), "who": "me", "k": {"a": 1.0}}
    savemat(tmp_path / "x.mat", {"t": TIME[None, :], "y": signals, **constants})
    found = propose_mapping(tmp_path / "x.mat")
    assert [guess.written for guess in found.guesses] == [f"y_{k}" for k in range(1, 6)]
    assert any("posSensors" in remark for remark in found.remarks)
    text = (
        found.to_toml().replace('# [channels."y_2"]', '[channels."y_2"]').replace("# [channels.y_2]", "[channels.y_2]")
    )
    rules = load_mapping(write(tmp_path, text, "m.toml"))
    assert read_record(tmp_path / "x.mat", mapping=rules).channels == ("y_2",)


@pytest.mark.parametrize("first", ["", "time,", "tick,"])
def test_a_file_that_gives_no_times_gets_a_mapping_with_a_place_for_the_rate(tmp_path, first):
    values = np.random.default_rng(1).standard_normal((400, 2))
    ticks = [f"{10 * k}," if first else "" for k in range(400)]
    rows = [f"{tick}{a:.6f},{b:.6f}" for tick, (a, b) in zip(ticks, values, strict=True)]
    path = tmp_path / "x.csv"
    path.write_text("\n".join([f"{first}ax_g,ay_g", *rows]) + "\n")
    proposal = propose_mapping(path)
    assert "The file gives no times" in str(proposal)
    assert "Hz." not in str(proposal)
    mapping = tmp_path / "m.toml"
    mapping.write_text(proposal.to_toml())
    with pytest.raises(RecordError, match="rate"):
        read_record(path, mapping=mapping)
    mapping.write_text(proposal.to_toml().replace("# ? rate = # Hz", "rate = 20.0"))
    record = read_record(path, mapping=mapping)
    assert record.rate == pytest.approx(20.0)
    assert set(record.channels) >= {"ax", "ay"}


def test_a_time_that_a_mapping_gives_wrongly_is_refused_and_not_counted(tmp_path):
    path = tmp_path / "x.csv"
    path.write_text("a_g,b_g\n" + "1,2\n" * 20)
    with pytest.raises(ConfigurationError, match="time"):
        propose_mapping(path, Mapping(time=TimeRule(column="clock")))


@pytest.mark.parametrize(
    ("columns", "names"),
    [
        (("X", "Y"), ["tower_z_acceleration", "tower_x_acceleration"]),
        (("X", "Y up", "Z"), ["tower_x_acceleration", None, None]),
        (("X up", "Y"), ["tower_y_acceleration", "tower_x_acceleration"]),
        (("X", "Y", "acc fa"), [None, None, "tower_z_acceleration"]),
    ],
)
def test_horizontal_axes_are_neither_upright_nor_named_twice(tmp_path, columns, names):
    """Y that carries gravity was proposed as side-side, and X as fore-aft next to a channel that is called so."""
    rng = np.random.default_rng(1)
    time = np.arange(0.0, 60.0, 0.1)
    values = {f"{name} [m/s^2]": rng.normal(9.81 * name.endswith("up"), 0.1, time.size) for name in columns}
    pd.DataFrame({"time [s]": time, **values}).to_csv(tmp_path / "record.csv", index=False)
    assert [guess.name for guess in propose_mapping(tmp_path / "record.csv").guesses] == names
