"""Who may see the page."""

from __future__ import annotations

import pytest

from tsepm_ros.tools.viewer.page_server import Access, token_for

LOCAL = Access.to("127.0.0.1", "")
SHARED = Access.to("0.0.0.0", "a-token-of-some-length")


@pytest.mark.parametrize("address", ["127.0.0.1", "127.1.2.3", "::1"])
def test_this_machine_alone_needs_no_token(address):
    assert token_for([address], "") == ""


@pytest.mark.parametrize("address", ["0.0.0.0", "::", "192.168.1.5", "fe80::1%eth0"])
def test_what_others_can_reach_needs_one(address):
    first, second = (token_for(["127.0.0.1", address], "") for _ in range(2))
    assert len(first) >= 32 and first != second
    for addresses in ([address], ["127.0.0.1"]):  # one that is given is demanded here too
        assert token_for(addresses, "a-token-of-some-length") == "a-token-of-some-length"


@pytest.mark.parametrize(
    "host", ["localhost", "localhost:8470", "127.0.0.1:9000", "[::1]:8470", "LOCALHOST:1"]
)
def test_names_of_this_machine_are_allowed(host):
    assert LOCAL.allows_host(host)


def test_with_a_token_addresses_are_allowed_and_foreign_names_are_not():
    assert SHARED.allows_host("192.168.1.5:8470")
    for host in ("evil.example:8470", "localhost.evil.example", "[bad", "a@b@c"):
        assert not SHARED.allows_host(host) and not LOCAL.allows_host(host)
    assert Access.to("Boat.example", "t").allows_host("boat.example:8470")
    for given in ("", "a-token-of-some-lengtH", "a-token-of-some-length-", "ä"):
        assert not SHARED.allows_token(given) and LOCAL.allows_token(given)
    assert SHARED.allows_token("a-token-of-some-length")


def test_the_page_itself_may_ask():
    for origin, allowed in ((None, True), ("http://localhost:8470", True), ("", False)):
        assert LOCAL.allows_origin(origin, "localhost:8470") is allowed
