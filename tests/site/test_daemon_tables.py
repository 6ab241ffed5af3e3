"""The tables about the daemon itself refuse what would be unsafe or mean nothing."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from fieldlink.site.daemon_tables import HistorianTable, WebSettings


@pytest.mark.parametrize("host", ["0.0.0.0", "192.0.2.7", "::", "plc-gateway"])
def test_other_machines_need_a_token_and_tls(host: str) -> None:
    token: dict[str, Any] = {"token_file": "token"}
    tls: dict[str, Any] = {"tls_certificate": "a.pem", "tls_key": "b.pem"}
    for too_little in ({}, token, tls):
        with pytest.raises(ValidationError, match="lets other machines in"):
            WebSettings(host=host, **too_little)
    assert WebSettings(host=host, enabled=False).host == host
    assert not WebSettings(host=host, **token, **tls).is_local


@pytest.mark.parametrize("host", ["127.0.0.1", "127.8.8.8", "::1", "localhost"])
def test_this_machine_needs_nothing(host: str) -> None:
    assert WebSettings(host=host).is_local


def test_a_key_without_a_certificate_is_refused() -> None:
    with pytest.raises(ValidationError, match="belong together"):
        WebSettings(tls_key="b.pem")  # type: ignore[arg-type]


def test_averages_need_samples_that_grow_old() -> None:
    with pytest.raises(ValidationError, match="give retention_days"):
        HistorianTable(average_minutes=10.0)
    assert HistorianTable(average_minutes=10.0, retention_days=30.0).average_minutes == 10.0
