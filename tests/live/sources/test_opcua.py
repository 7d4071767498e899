"""SCADA channels are read at even times; a server that was restarted is read again."""

import asyncio
import itertools
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.live.sources.conftest import Service, Taker
from tests.live.sources.servers import free_port, wait_for
from windsysid.errors import ConfigurationError
from windsysid.live.configuration.source_settings import Certificates
from windsysid.live.sources.opcua import OpcuaSource, _number

asyncua = pytest.importorskip("asyncua", reason="asyncua is not installed")

NODES = {"rotor_speed": ("ns=2;s=Rotor.Speed", "rpm"), "wind_speed": ("ns=2;s=Wind.Speed", "m/s")}


class Scada:
    """A server in a thread of its own, on a port that stays the same."""

    def __init__(self, port: int, certificate: tuple[Path, Path] | None = None) -> None:
        self.url, self.certificate = f"opc.tcp://127.0.0.1:{port}/scada/", certificate
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self._nodes: dict[str, Any] = {}
        self._server = self._do(self._start())

    def _do(self, coroutine: Any) -> Any:
        return asyncio.run_coroutine_threadsafe(coroutine, self._loop).result(60.0)

    async def _start(self) -> Any:
        server = asyncua.Server()
        await server.init()
        server.set_endpoint(self.url)
        if self.certificate is not None:
            server.set_security_policy([asyncua.ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt])
            await server.load_certificate(self.certificate[0])
            await server.load_private_key(self.certificate[1])
        await server.register_namespace("scada")
        for name in ("Rotor.Speed", "Wind.Speed"):
            node = asyncua.ua.NodeId(name, 2)
            self._nodes[name] = await server.nodes.objects.add_variable(node, name, 12.0)
        await server.start()
        return server

    def set(self, name: str, value: Any) -> None:
        self._do(self._nodes[name].write_value(value))

    def away(self) -> None:
        self._do(self._server.stop())

    def back(self) -> None:
        self._do(self._server.start())

    def stop(self) -> None:
        self.away()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(10.0)
        self._loop.close()


def certificate_of(name: str, folder: Path, suffix: str = ".pem") -> tuple[Path, Path]:
    """A certificate signed by itself, and its key."""
    from asyncua.crypto import cert_gen
    from cryptography import x509
    from cryptography.hazmat.primitives.serialization import Encoding
    from cryptography.x509.oid import ExtendedKeyUsageOID

    key = cert_gen.generate_private_key()
    names = [x509.UniformResourceIdentifier(f"urn:{name}"), x509.DNSName("localhost")]
    usage = [ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH]
    made = cert_gen.generate_self_signed_app_certificate(key, name, {}, names, usage)
    certificate, secret = folder / f"{name}{suffix}", folder / f"{name}-key{suffix}"
    certificate.write_bytes(made.public_bytes(Encoding.PEM))
    secret.write_bytes(cert_gen.dump_private_key_as_pem(key))
    return certificate, secret


def rows_of(service: Service) -> np.ndarray:
    blocks = [block.values for block in service.taker.blocks]
    return np.concatenate(blocks) if blocks else np.empty((0, 2))


def test_nodes_are_read_at_even_times_and_after_the_server_was_restarted(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("windsysid.live.sources.opcua.BLOCK_SECONDS", 0.4)
    scada = Scada(free_port())
    source = OpcuaSource(scada.url, "T01", NODES, every=0.1)
    service = Service(source)
    wait_for(lambda: len(rows_of(service)) >= 8)
    scada.set("Wind.Speed", float("nan"))
    wait_for(lambda: bool(np.isnan(rows_of(service)[:, 1]).any()))
    scada.away()
    wait_for(lambda: source.state.state == "trying")
    before = len(service.taker.blocks)
    scada.back()
    scada.set("Rotor.Speed", 7.0)
    wait_for(lambda: bool((rows_of(service)[:, 0] == 7.0).any()))
    assert source.state.state == "running"
    service.stop()
    scada.stop()
    blocks = service.taker.blocks
    assert len(blocks) > before
    for block in blocks:
        assert (block.turbine, block.stream, block.channels) == ("T01", "scada", ("rotor_speed", "wind_speed"))
        assert block.units == ("rpm", "m/s")
        assert block.rate == 10.0
        assert block.start % 100_000_000 == 0
    for one, following in itertools.pairwise(blocks):
        assert following.start >= one.start + len(one.values) * 100_000_000
    speeds = rows_of(service)[:, 0]
    assert set(speeds[np.isfinite(speeds)]) == {12.0, 7.0}


def test_a_node_that_is_none_is_said_in_a_line():
    async def run() -> None:
        source = OpcuaSource("opc.tcp://127.0.0.1:1/", "T01", {"x": ("nonsense", "m")})
        await source.run(Taker().push, asyncio.Event())

    with pytest.raises(ValueError, match=r"expected one such as ns=2;s=Rotor.Speed"):
        asyncio.run(run())


def test_a_value_that_the_server_calls_bad_or_that_is_no_number_is_missing():
    ua = asyncua.ua

    def read(value: object, code: int = 0) -> float:
        return _number(ua.DataValue(ua.Variant(value), StatusCode=ua.StatusCode(ua.UInt32(code))))

    assert read(3) == 3.0
    assert read(True) == 1.0
    assert np.isnan(read(3.0, ua.StatusCodes.BadSensorFailure))
    assert np.isnan(read("running"))
    assert np.isnan(read(float("inf")))


def test_a_server_with_certificates_is_read_encrypted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("windsysid.live.sources.opcua.BLOCK_SECONDS", 0.4)
    served, own = certificate_of("scada", tmp_path), certificate_of("windsysid", tmp_path, ".crt")
    scada = Scada(free_port(), served)
    try:
        plain = OpcuaSource(scada.url, "T01", NODES, every=0.1)
        service = Service(plain)
        wait_for(lambda: plain.state.state == "trying")  # it talks to nobody who does not encrypt
        service.stop()
        assert not service.taker.blocks
        service = Service(OpcuaSource(scada.url, "T01", NODES, every=0.1, secured=Certificates(*own, served[0])))
        wait_for(lambda: len(rows_of(service)) >= 8)
        service.stop()
        other = OpcuaSource(scada.url, "T01", NODES, every=0.1, secured=Certificates(*own, own[0]))
        service = Service(other)
        wait_for(lambda: "the server's certificate is not server_certificate" in other.state.text)
        service.stop()
        assert not service.taker.blocks
    finally:
        scada.stop()


def test_a_file_that_is_no_certificate_is_one_clear_error(tmp_path: Path):
    own = certificate_of("windsysid", tmp_path)
    broken = tmp_path / "broken.pem"
    broken.write_text("-----BEGIN CERTIFICATE-----\nnothing\n")
    source = OpcuaSource("opc.tcp://127.0.0.1:1/", "T01", NODES, secured=Certificates(broken, own[1], own[0]))
    with pytest.raises(ConfigurationError, match="expected PEM or DER files"):
        asyncio.run(asyncio.wait_for(source.run(Taker().push, asyncio.Event()), 20.0))
