"""Records in an object store become the rows that they become from files."""

import shutil
import socket
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.fleet.conftest import rows_of
from windsysid.errors import ConfigurationError
from windsysid.fleet.batch import Batch, batch
from windsysid.fleet.remote import fetched, list_remote, size_of

pytest.importorskip("pyarrow.fs")


@pytest.fixture(scope="module")
def bucket(data: Path) -> Iterator[str]:
    """The session's records in a bucket of moto's server, which speaks as S3 does."""
    server = shutil.which("moto_server")
    if server is None:
        pytest.skip("moto[server] is not installed: it wants an older python-dateutil than ours")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"http://127.0.0.1:{port}"
    process = subprocess.Popen(
        [server, "-H", "127.0.0.1", "-p", str(port)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    with pytest.MonkeyPatch.context() as patch:
        for name, value in {
            "AWS_ENDPOINT_URL": address, "AWS_ACCESS_KEY_ID": "test", "AWS_SECRET_ACCESS_KEY": "test",
            "AWS_DEFAULT_REGION": "us-east-1",
        }.items():  # fmt: skip
            patch.setenv(name, value)
        try:
            for _ in range(100):
                with socket.socket() as there:
                    if there.connect_ex(("127.0.0.1", port)) == 0:
                        break
                time.sleep(0.1)
            else:
                pytest.skip("moto_server does not answer")
            _put(f"{address}/loggers")
            for path in (data / "T01").iterdir():
                _put(f"{address}/loggers/site/T01/{path.name}", path.read_bytes())
            yield "s3://loggers/site"
        finally:
            process.kill()
            process.wait()


def _put(address: str, content: bytes = b"") -> None:
    headers = {"Content-Type": "application/octet-stream"}
    urllib.request.urlopen(urllib.request.Request(address, content, headers, method="PUT")).close()


@pytest.mark.slow
def test_records_of_a_bucket_are_the_rows_of_the_files(
    bucket: str, taken: tuple[Batch, Path], fleet: Path, tmp_path: Path
):
    from_files = {Path(row["source"]).name: row for row in rows_of(taken[1])}
    found = batch(bucket, fleet=fleet, archive=tmp_path / "a", workers=1)
    assert found.taken == taken[0].taken
    for row in rows_of(tmp_path / "a"):
        name = Path(row["source"]).name
        assert row["source"] == f"{bucket}/T01/{name}"
        same = from_files[name]
        assert {k: v for k, v in row.items() if k not in ("source", "why")} == {
            k: v for k, v in same.items() if k not in ("source", "why")
        }
        assert (row["why"] or "").replace(row["source"], "") == (same["why"] or "").replace(same["source"], "")
    again = batch(f"{bucket}/*/*.csv", fleet=fleet, archive=tmp_path / "a", workers=1)
    assert (again.taken, again.known) == ({}, len(from_files))


@pytest.fixture
def store(data: Path) -> str:
    """The same functions on files, which pyarrow opens by an address too."""
    return f"file://{data}"


def test_addresses_are_listed_fetched_and_measured(store: str, data: Path):
    listed = list_remote(f"{store}/T01")
    assert listed == sorted(f"{store}/T01/{path.name}" for path in (data / "T01").glob("*.csv"))
    assert list_remote(f"{store}/T0?/*.csv") == listed
    assert list_remote(listed[0]) == listed[:1]
    assert list_remote(f"{store}/none") == []
    with fetched(listed[0]) as copy:
        assert copy.read_bytes() == (data / "T01" / copy.name).read_bytes()
        assert size_of(listed[0]) == copy.stat().st_size
    assert not copy.exists()
    with pytest.raises(FileNotFoundError):
        size_of(f"{store}/none.csv")


def test_a_store_that_nobody_knows_and_a_remote_archive_are_refused(tmp_path: Path, store: str):
    with pytest.raises(ConfigurationError, match="source ftp2://x/y: cannot be reached"):
        batch("ftp2://x/y", turbine="tower", archive=tmp_path / "a")
    with pytest.raises(ConfigurationError, match="records may be in an object store, the archive not"):
        batch(store, turbine="tower", archive="s3://bucket/archive")
