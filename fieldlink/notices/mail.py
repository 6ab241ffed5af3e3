"""A mail server: each notice is one e-mail.

The standard library's SMTP client waits, so each mail has a thread of its own that nothing waits
for: a server that drips its answers holds up neither the daemon nor its end.
"""

from __future__ import annotations

import asyncio
import platform
import smtplib
import socket
import ssl
import threading
from dataclasses import dataclass
from datetime import UTC, datetime
from email.headerregistry import Address
from email.message import EmailMessage
from email.utils import format_datetime
from hashlib import sha256

from fieldlink.notices.errors import NoticeError
from fieldlink.notices.notice import Notice
from fieldlink.printable import as_printable
from fieldlink.secret import Secret
from fieldlink.site.notify import MailSettings
from fieldlink.tls_words import tls_remedy, tls_words

__all__ = ["MailReceiver"]

STEP_PATIENCE = 10.0
"""Seconds for one answer of the mail server."""

PATIENCE = 60.0
"""Seconds for a mail in all: six steps, of which one or two are slow where mail is checked."""

LONGEST_SUBJECT = 150
"""Characters: what the lists of mail programs show, and more."""


@dataclass(frozen=True, slots=True)
class _Outcome:
    """What is wrong with a mail: nobody gets it, or some do not; empty where all is well."""

    problem: str = ""
    flaw: str = ""


class MailReceiver:
    """Sends notices as mails.

    Args:
        settings: server and addresses.
        password: of the user; None without one.
        tls: certificates for the server.
    """

    def __init__(
        self, settings: MailSettings, password: Secret | None, tls: ssl.SSLContext
    ) -> None:
        self._settings, self._password, self._tls = settings, password, tls
        self.where = f"{settings.host}:{settings.port}"

    async def send(self, notice: Notice) -> str:
        """Mail a notice; see `Receiver.send`."""
        loop = asyncio.get_running_loop()
        done: asyncio.Future[_Outcome] = loop.create_future()

        def settle(outcome: _Outcome) -> None:
            if not done.done():
                done.set_result(outcome)

        def work() -> None:
            try:
                outcome = self._deliver(_mail_of(notice, self._settings))
            except Exception as error:  # noqa: BLE001  (the answer that `send` waits for)
                said = f"{self.where}: the mail cannot be sent ({type(error).__name__})"
                outcome = _Outcome(problem=said)
            try:
                loop.call_soon_threadsafe(settle, outcome)
            except RuntimeError:
                # the daemon has ended meanwhile; its outbox tries again at the next start
                return

        threading.Thread(target=work, name="mail", daemon=True).start()
        try:
            async with asyncio.timeout(PATIENCE):
                outcome = await done
        except TimeoutError as error:
            raise NoticeError(f"{self.where} took more than {PATIENCE:g} s for a mail") from error
        if outcome.problem:
            raise NoticeError(outcome.problem)
        return outcome.flaw

    def _deliver(self, mail: EmailMessage) -> _Outcome:
        """Deliver; return what is wrong."""
        try:
            refused = self._hand_over(mail)
        except (OSError, UnicodeError, smtplib.SMTPException) as error:
            return _Outcome(problem=self._words_of(error))
        if not refused:
            return _Outcome()
        who = ", ".join(f"{address} (SMTP {code})" for address, (code, _) in refused.items())
        return _Outcome(flaw=f"{self.where} takes no mail for {who}; correct notify.mail.to")

    def _hand_over(self, mail: EmailMessage) -> dict[str, tuple[int, bytes]]:
        """Hand the mail to the server; return the addresses that it refuses beside others."""
        settings = self._settings
        with self._connect() as server:
            if settings.security == "starttls":
                server.starttls(context=self._tls)
            if self._password is not None:
                assert settings.username is not None
                server.login(settings.username, self._password.reveal())
            return server.send_message(mail)

    def _words_of(self, error: Exception) -> str:
        """Return in a sentence why nobody gets the mail."""
        late = f"{self.where} did not answer within {STEP_PATIENCE:g} s"
        match error:
            case smtplib.SMTPAuthenticationError():
                return f"{self.where} refuses user name or password (SMTP {error.smtp_code})"
            case smtplib.SMTPNotSupportedError():
                return (
                    f"{self.where} does not offer what notify.mail asks for (STARTTLS or a login); "
                    "check security, port and username"
                )
            case smtplib.SMTPRecipientsRefused():
                return f"{self.where} refuses every address in notify.mail.to; correct them"
            case smtplib.SMTPResponseException():
                return f"{self.where} refuses the mail (SMTP {error.smtp_code}); see its log"
            case smtplib.SMTPException():
                if isinstance(error.__context__, TimeoutError):
                    return late
                return f"{self.where} ended the connection before it took the mail"
            case ssl.SSLError():
                remedy = tls_remedy(error, "notify.mail.ca", host="notify.mail.host")
                return f"{self.where}: {tls_words(error)}; {remedy or 'check port and security'}"
            case TimeoutError():
                return late
            case UnicodeError():
                return f"{self.where} cannot be reached: its name is not a host name; check host"
            case socket.gaierror():
                said = "no address is known for its name; check host"
                return f"{self.where} cannot be reached: {said}"
        said = (getattr(error, "strerror", None) or "the connection was lost").lower()
        return f"{self.where} cannot be reached: {said}; check host, port and network"

    def _connect(self) -> smtplib.SMTP:
        settings = self._settings
        # the default asks name servers for our own name, which may take a minute
        name = platform.node() or "localhost"
        if settings.security == "tls":
            return smtplib.SMTP_SSL(
                settings.host,
                settings.port,
                local_hostname=name,
                timeout=STEP_PATIENCE,
                context=self._tls,
            )
        return smtplib.SMTP(
            settings.host, settings.port, local_hostname=name, timeout=STEP_PATIENCE
        )


def _mail_of(notice: Notice, settings: MailSettings) -> EmailMessage:
    mail = EmailMessage()
    mail["Subject"] = as_printable(f"[{notice.site}] {notice.title}")[:LONGEST_SUBJECT]
    mail["From"] = Address("fieldlink", addr_spec=settings.sender)
    mail["To"] = [Address(addr_spec=address) for address in settings.to]
    mail["Date"] = format_datetime(datetime.fromtimestamp(notice.utc_ms / 1000.0, UTC))
    # the same for every attempt, so that a mail that came twice is shown once
    name = sha256(f"{notice.site}/{notice.id}".encode()).hexdigest()[:32]
    mail["Message-ID"] = f"<{name}@{settings.sender.partition('@')[2]}>"
    mail["Auto-Submitted"] = "auto-generated"
    mail.set_content(notice.text)
    return mail
