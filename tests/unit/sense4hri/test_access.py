"""Section 10 of the contract: who may do what over HTTP. Every rule is broken once."""

import socket

import pytest
from sense4hri.access import JSON, Access, Asked, Role, authorization, in_url, is_loopback
from sense4hri.errors import ConfigError

HERE = Asked(host="127.0.0.1:9464", content_type=JSON)
OPEN, CLOSED = Access(), Access("0.0.0.0")
OPERATED = Access("0.0.0.0", operate_token="o" * 32)
GUARDED = Access("0.0.0.0", "o" * 32, "v" * 32)


def status(access: Access, role: Role, asked: Asked) -> int:
    """The status of the refusal, 200 where there is none."""
    denied = access.decide(role, asked)
    return 200 if denied is None else denied.status


def bearer(token: str, asked: Asked = HERE) -> Asked:
    return asked._replace(authorization=f"Bearer {token}")


def test_on_loopback_without_a_token_everybody_on_the_machine_operates():
    """That is what `make demo` is."""
    assert status(OPEN, Role.OPERATE, HERE) == 200
    assert OPEN.notice() == ""


@pytest.mark.parametrize("listens_on", ["0.0.0.0", "::", "192.168.1.5", "some-host", ""])
def test_elsewhere_without_an_operate_token_nothing_can_be_changed(listens_on):
    """Viewing stays open; the refusal and the first words of the process say how to set a token."""
    access = Access(listens_on)
    assert status(access, Role.VIEW, HERE) == 200
    denied = access.decide(Role.OPERATE, HERE)
    assert denied.status == 403
    assert "SENSE4HRI_OPERATE_TOKEN" in denied.error
    assert "SENSE4HRI_OPERATE_TOKEN" in access.notice()


def test_a_view_token_alone_lets_nobody_operate():
    """Once a token is set, loopback alone opens nothing more."""
    access = Access(view_token="v" * 32)
    assert status(access, Role.VIEW, HERE) == 401
    assert status(access, Role.OPERATE, bearer("v" * 32)) == 403
    assert access.notice()


@pytest.mark.parametrize(
    ("token", "views", "operates"), [("", 401, 401), ("v" * 32, 200, 403), ("o" * 32, 200, 200), ("o" * 31, 401, 401)]
)
def test_a_token_gives_its_role_and_operating_includes_viewing(token, views, operates):
    """None or a wrong one: 401. The view token for an order: 403."""
    for asked in (bearer(token), HERE._replace(cookie=f"other=a b; sense4hri_token_9464={token}; x")):
        assert status(GUARDED, Role.VIEW, asked) == views
        assert status(GUARDED, Role.OPERATE, asked) == operates


def test_a_token_counts_only_where_it_belongs():
    """As Bearer or in the cookie of this port; another scheme, or the cookie of another port or name, gives nothing."""
    token = "o" * 32
    others = [f"{name}={token}" for name in ("token", "sense4hri_token", "sense4hri_token_8080")]
    for asked in (HERE._replace(authorization=f"Basic {token}"), *(HERE._replace(cookie=other) for other in others)):
        assert status(GUARDED, Role.OPERATE, asked) == 401


def test_without_a_view_token_viewing_is_open_although_operating_is_not():
    """The operate token guards what changes the study."""
    assert status(OPERATED, Role.VIEW, HERE) == 200
    assert status(OPERATED, Role.OPERATE, HERE) == 401
    assert OPERATED.notice() == ""


@pytest.mark.parametrize(
    ("host", "answered"),
    [
        ("127.0.0.1", True),
        ("127.0.0.1:8080", True),
        ("localhost:8080", True),
        ("[::1]:8080", True),
        ("LOCALHOST", True),
        (socket.gethostname(), True),
        ("lab.example:9464", True),
        ("evil.example", False),
        ("127.0.0.1.evil.example", False),
        ("127.0.0.1@evil.example", False),
        ("evil.example/127.0.0.1", False),
        ("[::1", False),
        ("0.0.0.0:9464", False),
        ("", False),
    ],
)
def test_without_a_token_a_foreign_host_is_not_answered(host, answered):
    """A page whose name points at this machine, DNS rebinding, carries its own name in `Host`."""
    access = Access.from_environment("0.0.0.0", {"ALLOWED_HOSTS": "other.example, Lab.Example"})
    assert (status(access, Role.VIEW, HERE._replace(host=host)) == 200) is answered


@pytest.mark.parametrize("allowed", ["2001:DB8:0::20", "[2001:db8::20]:8443", "fe80::1, 2001:db8::20"])
def test_an_allowed_host_may_be_an_ipv6_address(allowed):
    """As `make up TLS=2001:db8::20` gives it, with or without brackets; `2001` alone is another host."""
    access = Access.from_environment("0.0.0.0", {"ALLOWED_HOSTS": allowed})
    assert status(access, Role.VIEW, HERE._replace(host="[2001:db8::20]:8443")) == 200
    assert status(access, Role.VIEW, HERE._replace(host="2001:8443")) == 403


def test_an_ipv6_address_has_brackets_in_a_url():
    """Nothing else has."""
    assert [in_url(host) for host in ("::1", "[::1]", "10.0.0.1", "lab.example")] == [
        "[::1]",
        "[::1]",
        "10.0.0.1",
        "lab.example",
    ]


def test_a_token_makes_up_for_the_name():
    """Whoever carries one is no page of the web, whatever name they know this machine by."""
    assert status(GUARDED, Role.OPERATE, bearer("o" * 32, HERE._replace(host="lab.example"))) == 200
    assert status(GUARDED, Role.OPERATE, bearer("x" * 32, HERE._replace(host="lab.example"))) == 403


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1:9999", "file://", "http://127.0.0.1"]
)
def test_another_sites_page_is_refused_even_with_a_token(origin):
    """Its Origin is not ours; another port of this machine is another site."""
    for access, asked in ((OPEN, HERE), (GUARDED, bearer("o" * 32))):
        assert status(access, Role.OPERATE, asked._replace(origin=origin)) == 403


def test_the_own_page_may_order():
    """Over HTTP, and behind a proxy that speaks TLS."""
    for origin in ("http://127.0.0.1:9464", "https://127.0.0.1:9464"):
        assert status(OPEN, Role.OPERATE, HERE._replace(origin=origin)) == 200


@pytest.mark.parametrize(
    "kind", ["", "text/plain", "application/x-www-form-urlencoded", "text/plain; application/json"]
)
def test_only_json_changes_anything(kind):
    """A form of another site can send everything else without asking first."""
    assert status(OPEN, Role.OPERATE, HERE._replace(content_type=kind)) == 415
    assert status(OPEN, Role.VIEW, HERE._replace(content_type=kind)) == 200
    assert status(OPEN, Role.OPERATE, HERE._replace(content_type="Application/JSON; charset=utf-8")) == 200


def test_no_refusal_tells_a_token():
    """Neither a sentence nor the notice holds what is secret."""
    told = [str(GUARDED.decide(role, asked)) for role in Role for asked in (HERE, bearer("guess"), Asked())]
    assert not any("ooo" in text or "vvv" in text or "guess" in text for text in [*told, GUARDED.notice()])


def test_tokens_come_from_the_environment_or_a_file(tmp_path):
    """The newline at a file's end is no part of the token; programs send the stronger one they have."""
    file = tmp_path / "token"
    file.write_text("from-a-file\n")
    environment = {"SENSE4HRI_OPERATE_TOKEN_FILE": str(file), "SENSE4HRI_VIEW_TOKEN": "seen"}
    access = Access.from_environment("0.0.0.0", environment)
    assert (access.operate_token, access.view_token) == ("from-a-file", "seen")
    assert authorization(environment) == {"Authorization": "Bearer from-a-file"}
    assert authorization({}) == {}


@pytest.mark.parametrize("content", ["", " \n", "two words", 'quote"', "größe", "a" * 513])
def test_a_token_that_no_header_can_carry_is_a_configuration_error(tmp_path, content):
    """The error names the variable and not the token."""
    file = tmp_path / "token"
    file.write_text(content)
    with pytest.raises(ConfigError, match="SENSE4HRI_VIEW_TOKEN_FILE must hold"):
        Access.from_environment("127.0.0.1", {"SENSE4HRI_VIEW_TOKEN_FILE": str(file)})
    with pytest.raises(ConfigError, match=r"SENSE4HRI_VIEW_TOKEN_FILE is .* cannot be read"):
        Access.from_environment("127.0.0.1", {"SENSE4HRI_VIEW_TOKEN_FILE": str(tmp_path / "none")})


def test_what_loopback_is():
    """Addresses and the one name for which it is certain."""
    assert all(map(is_loopback, ["127.0.0.1", "127.1.2.3", "::1", "[::1]", "localhost"]))
    assert not any(map(is_loopback, ["0.0.0.0", "::", "10.0.0.1", "localhost.evil.example", ""]))
