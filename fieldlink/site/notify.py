"""``[notify]``: who gets notices of confirmed findings and lost devices, and how."""

from __future__ import annotations

import re
from email.errors import MessageError
from email.headerregistry import Address
from pathlib import Path
from typing import Any, Literal, Self
from urllib.parse import urlsplit

from pydantic import Field, model_validator

from fieldlink.site.base import Model, is_loopback

__all__ = ["MailSettings", "NotifySettings", "WebHookSettings"]

SMTP_PORTS = {"starttls": 587, "tls": 465, "none": 25}
"""The ports that IANA registers for mail submission with STARTTLS, with TLS, and for SMTP."""

_ADDRESS = re.compile(r"[^@\s<>,;]+@[^@\s<>,;]+")


def _refuse_bad_address(key: str, url: str) -> None:
    """Refuse what is not a web address; only the scheme and host are shown."""
    try:
        parts = urlsplit(url)
        host, _ = parts.hostname, parts.port
    except ValueError:
        parts, host = urlsplit(""), None
    if parts.scheme not in ("http", "https") or not host:
        raise ValueError(f"{key} is not a web address; write https://HOST/PATH")


class WebHookSettings(Model):
    """``[notify.web_hook]``: a POST of JSON for each notice; needs the extra notify."""

    url: str | None = None
    """Address that takes the notices."""
    url_file: Path | None = None
    """File with the address instead, where the address itself is a secret."""
    token_file: Path | None = None
    """File with a token, sent as Authorization: Bearer; relative to the site file."""
    token_variable: str | None = Field(default=None, min_length=1)
    """Environment variable with the token, instead of a file."""
    ca: Path | None = None
    """Certificates (PEM) that may have signed the receiver's; the system's unless given."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if (self.url is None) == (self.url_file is None):
            raise ValueError("exactly one of url and url_file is needed; give one of them")
        if self.token_file is not None and self.token_variable is not None:
            raise ValueError("token_file and token_variable are both given; keep one of them")
        if self.url is not None:
            _refuse_bad_address("url", self.url)
            parts = urlsplit(self.url)
            has_secret = self.token_file is not None or self.token_variable is not None
            has_secret |= parts.password is not None
            if has_secret and parts.scheme == "http" and not is_loopback(parts.hostname or ""):
                raise ValueError(
                    "the token or password would cross the network unencrypted; use an https "
                    "address"
                )
        return self


def _default_port(keys: dict[str, Any]) -> int:
    return SMTP_PORTS[keys.get("security", "starttls")]


def _is_mail_address(text: str) -> bool:
    """Whether every mail server takes the address: RFC 5321 knows ASCII alone."""
    try:
        Address(addr_spec=text)
    except (ValueError, MessageError):
        return False
    return text.isascii() and _ADDRESS.fullmatch(text) is not None


class MailSettings(Model):
    """``[notify.mail]``: an e-mail for each notice."""

    host: str = Field(min_length=1)
    """Mail server."""
    security: Literal["starttls", "tls", "none"] = "starttls"
    """How the connection is encrypted; none only without a password or on this machine."""
    port: int = Field(default_factory=_default_port, ge=1, le=0xFFFF)
    """TCP port; 587, 465 or 25 by the security unless given."""
    sender: str
    """Address from which the mails come."""
    to: tuple[str, ...] = Field(min_length=1)
    """Addresses that get the mails."""
    username: str | None = None
    """User name at the mail server."""
    password_file: Path | None = None
    """File with the password and nothing else, relative to the site file."""
    password_variable: str | None = Field(default=None, min_length=1)
    """Environment variable with the password, instead of a file."""
    ca: Path | None = None
    """Certificates (PEM) that may have signed the server's; the system's unless given."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.password_file is not None and self.password_variable is not None:
            raise ValueError("password_file and password_variable are both given; keep one of them")
        has_password = self.password_file is not None or self.password_variable is not None
        if (self.username is not None) != has_password:
            raise ValueError(
                "username and a password belong together; give both or neither, the password as "
                "password_file or password_variable"
            )
        if has_password and self.security == "none" and not is_loopback(self.host):
            raise ValueError(
                'the password would cross the network unencrypted; use security = "starttls" or '
                '"tls"'
            )
        for address in (self.sender, *self.to):
            if not _is_mail_address(address):
                raise ValueError(f'"{address}" is not a mail address; write NAME@HOST in ASCII')
        return self


class NotifySettings(Model):
    """``[notify]``: a notice for each confirmed finding and each device lost or back."""

    page: str
    """Address of the operators' page as its readers reach it, for the links in notices."""
    about: tuple[Literal["findings", "devices"], ...] = Field(
        default=("findings", "devices"), min_length=1
    )
    """What notices are about."""
    lost_after: float = Field(default=60.0, ge=0, le=86400)
    """Seconds that a device must be silent to count as lost."""
    per_hour: int = Field(default=20, ge=1, le=1000)
    """Most notices in an hour; what is beyond comes as one notice with a list."""
    web_hook: WebHookSettings | None = None
    """Receiver over HTTP."""
    mail: MailSettings | None = None
    """Receivers by e-mail."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        _refuse_bad_address("page", self.page)
        parts = urlsplit(self.page)
        if parts.query or parts.fragment or parts.username is not None:
            raise ValueError(
                "page has a user name, a ? or a #, and links begin with it; write https://HOST/PATH"
            )
        if self.web_hook is None and self.mail is None:
            raise ValueError("no receiver is named; add the table web_hook or mail")
        return self
