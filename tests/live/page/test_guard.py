import pytest
from fastapi.testclient import TestClient

from windsysid.live.page.access import Access
from windsysid.live.page.app import app
from windsysid.live.page.guard import Buckets, RequestLimits

READ, OPERATE = "r" * 20, "o" * 20
OWN = "http://localhost"


def test_every_answer_says_what_browsers_must_refuse(page):
    client = TestClient(page, base_url=OWN)
    for path in ("/", "/api/overview", "/nothing", "/static/page.css"):
        headers = client.get(path).headers
        assert "default-src 'self'" in headers["content-security-policy"]
        assert "unsafe" not in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["x-frame-options"] == "DENY"
    assert client.get("/api/overview").headers["cache-control"] == "no-store"


@pytest.mark.parametrize("host", ["evil.example", "localhost.evil.example", "127.0.0.1.evil.example", ""])
def test_without_tokens_no_foreign_name_leads_here(page, host):
    assert TestClient(page, base_url=OWN).get("/api/overview", headers={"host": host}).status_code == 403


@pytest.mark.parametrize("host", ["localhost", "localhost:8765", "127.0.0.1:1", "[::1]:8765", "[::1]"])
def test_names_of_this_machine_lead_here(page, host):
    assert TestClient(page, base_url=OWN).get("/api/overview", headers={"host": host}).status_code == 200


@pytest.mark.parametrize(
    "headers", [{"origin": "http://evil.example"}, {"origin": "null"}, {"sec-fetch-site": "cross-site"}]
)
def test_no_other_page_acknowledges(page, headers):
    answer = TestClient(page, base_url=OWN).post("/api/alarms/x/acknowledge", json={"by": "me"}, headers=headers)
    assert answer.status_code == 403


def test_what_is_too_large_is_refused(page):
    client = TestClient(page, base_url=OWN)
    path = "/api/alarms/x/acknowledge"
    assert client.post(path, content=b"x" * 20_000).status_code == 413
    assert client.post(path, content=(b"x" * 5_000 for _ in range(4))).status_code == 413
    assert client.get("/api/overview", headers={"x-much": "x" * 20_000}).status_code == 431
    assert client.get("/api/alarms?turbine=" + "x" * 5_000).status_code == 414
    paths = client.get("/api/openapi.json").json()["paths"]
    assert all({"413", "414"} <= set(one["responses"]) for path in paths.values() for one in path.values())


def test_who_asks_too_often_waits(store):
    client = TestClient(app(store, limits=RequestLimits(rate=0.001, burst=5)), base_url=OWN)
    statuses = [client.get("/health").status_code for _ in range(7)]
    assert statuses == [200] * 5 + [429] * 2


def test_buckets_forget_the_longest_unused():
    buckets = Buckets(rate=0.0, burst=1.0, clients=2)
    assert [buckets.take(client) for client in "aabcc"] == [True, False, True, True, False]
    assert buckets.take("a")  # forgotten: it may again


def test_nothing_is_told_without_a_token(store):
    client = TestClient(app(store, access=Access(READ, OPERATE)), base_url="http://site:8765")
    for path in (
        "/api/overview",
        "/api/turbines/T01",
        "/api/turbines/nothing/levels",
        "/api/alarms",
        "/api/events",
        "/metrics",
    ):
        answer = client.get(path)
        assert answer.status_code == 401
        assert "T01" not in answer.text
    assert client.get("/health").status_code == 200
    assert client.get("/").status_code == 200


def test_readers_look_and_operators_act(store):
    client = TestClient(app(store, access=Access(READ, OPERATE)), base_url="http://site:8765")
    read, operate = ({"authorization": f"Bearer {token}"} for token in (READ, OPERATE))
    assert client.get("/api/overview", headers=read).json()["role"] == "reader"
    assert client.get("/metrics", headers=read).status_code == 200
    path = "/api/alarms/T03/blade_2_lag_acceleration/1/acknowledge"
    assert client.post(path, json={"by": "me"}, headers=read).status_code == 403
    assert client.post(path, json={"by": "me"}, headers=operate).json()["by"] == "me"


def test_wrong_tokens_wait_and_the_right_one_of_the_same_address_never_does(store):
    """Behind a proxy all come from one address."""
    client = TestClient(app(store, access=Access(READ), limits=RequestLimits(guesses=3)), base_url="http://site")

    def status(token: str) -> int:
        return int(client.get("/api/overview", headers={"authorization": f"Bearer {token}"}).status_code)

    assert [status(token) for token in ["x" * 20] * 4 + [READ] * 3 + ["y" * 20]] == [401] * 3 + [429] + [200] * 3 + [
        429
    ]
    assert client.post("/login", data={"token": "x" * 20}, follow_redirects=False).status_code == 429
    assert "set-cookie" in client.post("/login", data={"token": READ}, follow_redirects=False).headers


def test_who_floods_without_a_token_takes_nothing_from_those_of_the_same_address_who_have_one(store):
    limits = RequestLimits(rate=0.001, burst=5, guesses=3)
    client = TestClient(app(store, access=Access(READ, OPERATE), limits=limits), base_url="http://site")
    bearer = {"authorization": f"Bearer {READ}"}
    assert [client.get("/", headers={"authorization": "Bearer x"}).status_code for _ in range(6)] == [200] * 5 + [429]
    assert client.get("/api/overview", headers=bearer).status_code == 200
    assert "set-cookie" in client.post("/login", data={"token": READ}, follow_redirects=False).headers  # a cookie
    assert [client.get("/api/overview").status_code for _ in range(5)] == [200] * 4 + [429]  # the rate of readers
    assert client.get("/api/overview", headers={"authorization": f"Bearer {OPERATE}"}).status_code == 200


def test_a_browser_logs_in_by_the_form_and_out_again(store):
    client = TestClient(app(store, access=Access(READ, OPERATE)), base_url="http://site")
    wrong = client.post("/login", data={"token": "x" * 20}, follow_redirects=False)
    assert wrong.headers["location"] == "/#login-failed"
    assert "set-cookie" not in wrong.headers
    right = client.post("/login", data={"token": READ}, follow_redirects=False)
    cookie = right.headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=strict" in cookie
    assert READ not in cookie
    assert client.get("/api/overview").status_code == 200
    client.post("/logout", headers={"origin": "http://site"}, follow_redirects=False)
    assert client.get("/api/overview").status_code == 401
