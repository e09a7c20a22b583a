"""The address that a browser is given."""

from __future__ import annotations

from urllib.parse import parse_qs, urlsplit

from aps.api.guard import ApiConfig
from lostlink.view.process import address_of


def test_the_address_brings_the_token_as_it_is() -> None:
    token = "a-token/of+this.test=="
    address = urlsplit(address_of(ApiConfig(host="::1", token=token), 8080))
    assert address.netloc == "[::1]:8080"
    assert parse_qs(address.query) == {"token": [token]}
    assert address_of(ApiConfig(), 8080) == "http://127.0.0.1:8080/"
