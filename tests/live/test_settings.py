"""A settings file is checked as a whole: all that is wrong is said at once, and secrets never."""

from pathlib import Path

import pytest

from windsysid.live.configuration.settings import MqttNotice, SettingsError, WebhookNotice, read_settings
from windsysid.live.configuration.source_settings import Certificates, FolderSettings, MqttSettings, OpcuaSettings
from windsysid.live.configuration.wiring import sources_of
from windsysid.live.sources.replay import Replay

SMALLEST = """
store = "store.sqlite"

[[turbine]]
name = "T01"
turbine = "tower"

[[source]]
kind = "mqtt"
broker = "mqtt://localhost"
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "live.toml"
    path.write_text(text, encoding="utf-8")
    return path


def faults(folder: Path, text: str) -> list[str]:
    with pytest.raises(SettingsError) as caught:
        read_settings(written(folder, text))
    for line in caught.value.lines:
        assert line.startswith(str(folder / "live.toml"))
        assert "\n" not in line
    return [line.removeprefix(f"{folder / 'live.toml'}: ") for line in caught.value.lines]


def test_the_smallest_file_has_defaults_for_all_else(tmp_path: Path):
    found = read_settings(written(tmp_path, SMALLEST))
    assert found.store == str(tmp_path / "store.sqlite")
    assert (found.window, found.lateness, found.silence, found.learn) == (600.0, 30.0, 300.0, 144)
    assert [member.name for member in found.turbines] == ["T01"]
    source = found.sources[0]
    assert isinstance(source, MqttSettings)
    assert source.topic == "windsysid/{turbine}/blocks"


def test_all_kinds_of_tables_are_read_with_their_secrets_from_files_and_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    for name in ("reader", "operator", "hook", "own.pem", "key.pem", "scada.der"):
        (tmp_path / name).write_text(f"secret of {name}\n", encoding="utf-8")
    (tmp_path / "records").mkdir()
    monkeypatch.setenv("BROKER_PASSWORD", "secret of broker")
    text = SMALLEST.replace('"mqtt://localhost"', '"mqtts://broker:8883"\nuser = "u"\npassword_env = "BROKER_PASSWORD"')
    text = text.replace('store = "store.sqlite"', 'store = "postgresql://u@db/live"\nwindow = "20 min"\nlearn = "1 d"')
    text += """
[[source]]
kind = "folder"
path = "records"
turbine = "T01"

[[source]]
kind = "opcua"
server = "opc.tcp://scada:4840"
certificate = "own.pem"
key = "key.pem"
server_certificate = "scada.der"
turbine = "T01"
every = "500 ms"
[[source.node]]
channel = "rotor_speed"
node = "ns=2;s=T01.RotorSpeed"
unit = "rpm"

[[notify]]
kind = "webhook"
url_file = "hook"

[[notify]]
kind = "mqtt"
broker = "mqtt://localhost"
severity = "alarm"

[page]
host = "0.0.0.0"
reader_token_file = "reader"
operator_token_file = "operator"

[keep]
levels = "10 years"

[log]
format = "json"
"""
    found = read_settings(written(tmp_path, text))
    assert found.store == "postgresql://u@db/live"
    assert found.learn == 72
    mqtt, folder, opcua = found.sources
    assert isinstance(mqtt, MqttSettings)
    assert mqtt.broker.password is not None
    assert mqtt.broker.password.value == "secret of broker"
    assert isinstance(folder, FolderSettings)
    assert isinstance(opcua, OpcuaSettings)
    assert opcua.nodes == {"rotor_speed": ("ns=2;s=T01.RotorSpeed", "rpm")}
    assert opcua.secured == Certificates(*(tmp_path / name for name in ("own.pem", "key.pem", "scada.der")))
    webhook, retained = found.notices
    assert isinstance(webhook, WebhookNotice)
    assert webhook.url.value == "secret of hook"
    assert isinstance(retained, MqttNotice)
    assert retained.severity == "alarm"
    assert found.page.operator is not None
    assert found.page.operator.value == "secret of operator"
    assert found.keep == {"levels": "10 years"}
    assert "secret of" not in repr(found)


def test_everything_that_is_wrong_is_said_at_once(tmp_path: Path):
    text = """
stor = "x"
store = "nowhere/store.sqlite"
window = "10"
workers = 1.5
[[turbine]]
name = "T01"
turbine = "towr"
[[turbine]]
turbine = "tower"
mapping = "logger.toml"
[[source]]
kind = "carrier pigeon"
[[source]]
kind = "mqtt"
broker = "mqtt://me:hunter2@broker"
topic = "blocks/#"
password_env = "NO_SUCH_VARIABLE"
[[notify]]
kind = "webhook"
url = "ftp://x"
[page]
host = "0.0.0.0"
port = 99999
[log]
format = "xml"
"""
    found = faults(tmp_path, text)
    assert "hunter2" not in " ".join(found)
    for expected in (
        "unknown key 'stor' (meant 'store'?)",
        f"store: the folder '{tmp_path}/nowhere' does not exist",
        'window: expected a time of "1 min" to "2 h", with its unit, got \'10\'',
        "workers: expected a whole number of 1 to 256, got 1.5",
        "[[turbine]] 1: ",
        "[[turbine]] 2: name is missing",
        "[[turbine]] 2: mapping: expected a file that is there",
        "[[source]] 1: kind: expected one of mqtt, folder, opcua, replay, got 'carrier pigeon'",
        "[[source]] 2: broker: holds a password",
        "[[source]] 2: topic: expected one level '{turbine}'",
        "[[source]] 2: password_env: the environment variable 'NO_SUCH_VARIABLE' is not set",
        "[[notify]] 1: url: expected a URL that begins with https:// or http://",
        "[page]: port: expected a whole number of 0 to 65535, got 99999",
        "[page]: host: '0.0.0.0' can be reached from other machines",
        "[log]: format: expected one of text, json, got 'xml'",
    ):
        assert any(line.startswith(expected) for line in found), (expected, found)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "store is missing"),
        ("store = 3", "store: expected a path"),
        ("turbine = 3\nsource = {}", "turbine: expected tables [[turbine]], got 3"),
        ('turbine = ["T01"]', "[[turbine]] 1: expected a table, got 'T01'"),
        ("page = true", "[page]: expected a table, got True"),
        ('store = "postgresql://u:hunter2@db/live"', "store: holds a password"),
        ('store = "postgresql://"', "store: expected a URL"),
        ('[[source]]\nkind = ["mqtt"]', "[[source]] 1: kind: expected one of"),
        ("workers = true", "workers: expected a whole number"),
        ("alarms_per_year = nan", "alarms_per_year: expected a number"),
        ('[page]\nreader_token_file = "empty"\nreader_token_env = "x"', "[page]: reader_token_file and"),
        ('[page]\nreader_token_file = "empty"', "[page]: reader_token_file: '"),
        ('[page]\ncertificate = "empty"', "[page]: certificate and key: expected both or neither"),
        (
            '[[source]]\nkind = "opcua"\nserver = "opc.tcp://scada"\nkey = "empty"',
            "[[source]] 1: certificate, key and server_certificate: expected all three or none, got no certificate",
        ),
    ],
)
def test_a_wrong_value_is_named(tmp_path: Path, text: str, expected: str):
    (tmp_path / "empty").touch()
    assert any(line.startswith(expected) for line in faults(tmp_path, text)), faults(tmp_path, text)


def test_what_is_no_toml_is_one_line(tmp_path: Path):
    assert len(faults(tmp_path, "store = [")) == 1
    with pytest.raises(SettingsError, match=r"nowhere\.toml: no such file, expected a settings file"):
        read_settings(tmp_path / "nowhere.toml")
    (tmp_path / "live.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SettingsError, match="is not a settings file"):
        read_settings(tmp_path / "live.toml")


def test_a_mapping_that_nothing_reads_is_refused(tmp_path: Path):
    (tmp_path / "logger.toml").write_text('[channels]\nAX = {name = "tower_x_acceleration", unit = "m/s^2"}\n')
    text = SMALLEST.replace('turbine = "tower"', 'turbine = "tower"\nmapping = "logger.toml"', 1)
    assert faults(tmp_path, text) == ["[[turbine]] 'T01': mapping is only for the sources folder and replay: remove it"]
    files = '[[source]]\nkind = "folder"\npath = "."\nturbine = "T01"\n'
    assert read_settings(written(tmp_path, text + files)).turbines[0].mapping is not None


def test_the_same_name_twice_is_refused(tmp_path: Path):
    twice = SMALLEST + '[[turbine]]\nname = "T01"\nturbine = "tower"\n'
    assert faults(tmp_path, twice) == ["[[turbine]]: two are called 'T01': give each a name of its own"]


@pytest.mark.parametrize(
    ("start", "expected"), [('"2026-01-05T12:00:00Z"', 1_767_614_400 * 10**9), ('"today"', None), ("17", None)]
)
def test_a_replay_begins_when_it_is_told(tmp_path: Path, start: str, expected: int | None):
    (tmp_path / "record.nc").write_bytes(b"")
    text = (
        'store = "s.sqlite"\n[[turbine]]\nname = "T01"\nturbine = "tower"\n'
        f'[[source]]\nkind = "replay"\nturbine = "T01"\nrecord = "record.nc"\nstart = {start}\n'
    )
    if expected is None:
        (fault,) = faults(tmp_path, text)
        assert 'start: expected a moment with its zone in quotes, such as "2026-01-05T12:00:00Z", got' in fault
        return
    settings = read_settings(written(tmp_path, text))
    (source,) = sources_of(settings)
    assert isinstance(source, Replay)
    assert source.begin == expected
