"""OPC UA devices in a site file: what is wrong is told in a sentence."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from fieldlink.links import LinkError, open_link
from fieldlink.site import Site, SiteError


@pytest.mark.parametrize(
    ("opcua", "rows", "said"),
    [
        ('security = "Basic256Sha256"', "", "needs cert, key and server_cert"),
        ('username = "me"', "", "username and password_file belong together"),
        ('exchange_node = "Exchange"', "", "is not a node id"),
        ("", "X,Temperature\n", "is not a node id"),
        ("", "L0.OP,ns=1;s=L0.OP\n", "is already on line 2"),
        ('cert = "none.pem"\nkey = "none.key"', "", "there is no file"),
    ],
)
def test_a_wrong_device_is_reported_in_a_sentence(
    make_opcua_site: Callable[..., Site], opcua: str, rows: str, said: str
) -> None:
    with pytest.raises(SiteError, match=said):
        make_opcua_site(1, opcua=opcua, rows=rows)


def test_without_the_package_the_link_says_what_to_install(
    make_opcua_site: Callable[..., Site], monkeypatch: pytest.MonkeyPatch
) -> None:
    site = make_opcua_site(1)
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(LinkError, match=r"pip install 'fieldlink\[opcua\]'"):
        open_link(site, "plc")
