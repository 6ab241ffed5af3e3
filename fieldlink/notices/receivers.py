"""The receivers that a site file names."""

from __future__ import annotations

import ssl
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

from fieldlink.notices.errors import NoticeError
from fieldlink.notices.mail import MailReceiver
from fieldlink.notices.notice import Notice
from fieldlink.notices.web_hook import WebHookReceiver
from fieldlink.secret import Secret, SecretError
from fieldlink.site import Site
from fieldlink.tls_words import tls_words

__all__ = ["Receiver", "receivers_of"]


class Receiver(Protocol):
    """A receiver of notices."""

    @property
    def where(self) -> str:
        """Its address as it may be shown: without secrets."""
        ...

    async def send(self, notice: Notice) -> str:
        """Deliver a notice; may take as long as the settings allow.

        Returns:
            Who does not get it, in a sentence, where others do; else empty.

        Raises:
            NoticeError: it was not taken.
        """
        ...


def receivers_of(site: Site) -> Mapping[str, Receiver]:
    """Return the receivers of a site by name, their files read.

    Raises:
        MissingExtraError: a package is not installed.
        NoticeError: a secret or certificate cannot be read or used.
    """
    notify = site.file.notify
    assert notify is not None
    found: dict[str, Receiver] = {}
    if (hook := notify.web_hook) is not None:
        key = "notify.web_hook"
        url = hook.url or _secret(site, f"{key}.url_file", hook.url_file, None).reveal().strip()
        token = None
        if hook.token_file is not None or hook.token_variable is not None:
            token = _secret(site, f"{key}.token", hook.token_file, hook.token_variable)
        found["web_hook"] = WebHookReceiver(site.path, url, token, _tls(site, key, hook.ca))
    if (mail := notify.mail) is not None:
        key = "notify.mail"
        password = None
        if mail.username is not None:
            password = _secret(site, f"{key}.password", mail.password_file, mail.password_variable)
            if not f"{mail.username}{password.reveal()}".isascii():
                # as smtplib has it: RFC 4954 leaves other characters to each way of logging in
                raise NoticeError(
                    f"{site.path}: {key}: user name or password has other characters than ASCII, "
                    "which a login over SMTP cannot carry; have another one set at the mail server"
                )
        found["mail"] = MailReceiver(mail, password, _tls(site, key, mail.ca))
    return found


def _secret(site: Site, key: str, file: Path | None, variable: str | None) -> Secret:
    try:
        if file is not None:
            return Secret.of_file(site.resolve(file))
        assert variable is not None
        return Secret.of_environment(variable)
    except SecretError as error:
        raise NoticeError(f"{site.path}: {key}: {error}") from error


def _tls(site: Site, key: str, ca: Path | None) -> ssl.SSLContext:
    try:
        return ssl.create_default_context(cafile=None if ca is None else str(site.resolve(ca)))
    except (OSError, ssl.SSLError) as error:
        raise NoticeError(
            f"{site.path}: {key}.ca: the certificates cannot be used "
            f"({tls_words(error, () if ca is None else [site.resolve(ca)])}); give a PEM file"
        ) from error
