"""How a broker is reached: the site file's table and the files that it names.

The files are read for every connection: a fault in one is told as a connection that was not made.
"""

from __future__ import annotations

import ssl
from dataclasses import dataclass, replace

from fieldlink.secret import Secret, SecretError
from fieldlink.site import Site
from fieldlink.tls_words import client_context, tls_words
from fieldlink.upward.errors import UpwardError

__all__ = ["BrokerSettings"]


@dataclass(frozen=True, slots=True)
class BrokerSettings:
    """How the broker is reached; the password is in no representation of it.

    Attributes:
        where: the address as people write it.
        client_id: our name there.
        tls: certificates, None without TLS.
    """

    host: str
    port: int
    client_id: str
    keepalive: int
    username: str | None = None
    password: Secret | None = None
    tls: ssl.SSLContext | None = None

    @property
    def where(self) -> str:
        """The address as people write it."""
        return f"{self.host}:{self.port}"

    @classmethod
    def without_files(cls, site: Site, suffix: str) -> BrokerSettings:
        """The settings without what files hold: password and certificates."""
        mqtt = site.file.mqtt
        assert mqtt is not None
        name = mqtt.client_id or f"fieldlink-{site.name}"
        return cls(mqtt.host, mqtt.port, f"{name}-{suffix}", mqtt.keepalive)

    @classmethod
    def of_site(cls, site: Site, suffix: str) -> BrokerSettings:
        """Read the settings and the files that they name.

        Raises:
            UpwardError: a file cannot be read.
        """
        address, mqtt = cls.without_files(site, suffix), site.file.mqtt
        assert mqtt is not None
        password = None
        if mqtt.password_file is not None:
            try:
                password = Secret.of_file(site.resolve(mqtt.password_file))
            except SecretError as error:
                raise UpwardError(f"{site.path}: mqtt.password_file: {error}") from error
        tls = None
        if mqtt.tls is not None:
            given = (mqtt.tls.ca, mqtt.tls.cert, mqtt.tls.key)
            files = [site.resolve(path) for path in given if path is not None]
            try:
                tls = client_context(files)
            except (OSError, ValueError) as error:
                raise UpwardError(
                    f"{site.path}: mqtt.tls: a certificate or key cannot be used "
                    f"({tls_words(error, files)}); give PEM files, the key "
                    "without a password and belonging to its certificate"
                ) from error
        return replace(address, username=mqtt.username, password=password, tls=tls)
